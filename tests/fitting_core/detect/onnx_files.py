"""Small ONNX models whose answers can be told from the image, written for tests."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

_OPSET, _IR = 17, 9
"""Old enough for every onnxruntime that is supported."""
POINTS = 133
MEAN = np.array([123.675, 116.28, 103.53])
DEVIATION = np.array([58.395, 57.12, 57.375])

Shape = Sequence[int | str]


def save(
    path: Path,
    nodes: Sequence[onnx.NodeProto],
    *,
    image: Shape,
    outputs: dict[str, Shape],
    constants: dict[str, np.ndarray] | None = None,
    integers: Sequence[str] = (),
) -> Path:
    """Write a model of one input, called image."""
    kinds = {name: TensorProto.INT64 if name in integers else TensorProto.FLOAT for name in outputs}
    graph = helper.make_graph(
        list(nodes),
        "test",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, list(image))],
        [helper.make_tensor_value_info(name, kinds[name], list(shape)) for name, shape in outputs.items()],
        [numpy_helper.from_array(value, name) for name, value in (constants or {}).items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", _OPSET)], ir_version=_IR)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))
    return path


def channels_of_points(count: int = POINTS) -> np.ndarray:
    """Which colour each point of `brightest_model` looks for: red, green, blue, red, ..."""
    return np.arange(count) % 3


def brightest_model(
    path: Path,
    *,
    size: tuple[int, int] = (48, 64),
    count: int = POINTS,
    ratio: int = 2,
    layout: str = "NCHW",
    batch: int | str = "batch",
    swapped: bool = False,
    height: float = 1.0,
) -> Path:
    """A SimCC model whose points lie where a colour is brightest, with peaks of a height for full brightness."""
    width, rows = size
    move = [helper.make_node("Transpose", ["image"], ["nchw"], perm=[0, 3, 1, 2])] if layout == "NHWC" else []
    nodes = [
        *move,
        # Back to 0 to 1, so that the peaks have the height that is asked for.
        helper.make_node("Mul", ["nchw" if move else "image", "deviation"], ["scaled"]),
        helper.make_node("Add", ["scaled", "mean"], ["bright"]),
        helper.make_node("ReduceMax", ["bright"], ["columns"], axes=[2], keepdims=0),
        helper.make_node("ReduceMax", ["bright"], ["rows"], axes=[3], keepdims=0),
    ]
    for name, line in (("x", "columns"), ("y", "rows")):
        nodes.append(helper.make_node("MatMul", ["chosen", line], [f"of_{name}"]))
        nodes.append(helper.make_node("MatMul", [f"of_{name}", f"finer_{name}"], [f"simcc_{name}"]))
    image: Shape = [batch, 3, rows, width] if layout == "NCHW" else [batch, rows, width, 3]
    names = ["simcc_y", "simcc_x"] if swapped else ["simcc_x", "simcc_y"]
    shapes: dict[str, Shape] = {
        "simcc_x": [batch, count, ratio * width],
        "simcc_y": [batch, count, ratio * rows],
    }
    constants = {
        "deviation": (DEVIATION / 255 * height).reshape(1, 3, 1, 1).astype(np.float32),
        "mean": (MEAN / 255 * height).reshape(1, 3, 1, 1).astype(np.float32),
        "chosen": np.eye(3, dtype=np.float32)[channels_of_points(count)],
        "finer_x": _finer(width, ratio),
        "finer_y": _finer(rows, ratio),
    }
    return save(path, nodes, image=image, outputs={name: shapes[name] for name in names}, constants=constants)


def _finer(length: int, ratio: int) -> np.ndarray:
    """Cubic interpolation (Catmull-Rom) to `ratio` bins for each pixel, the first of which is the pixel's centre."""
    places = np.arange(ratio * length) / ratio
    low = np.floor(places).astype(int)
    t = places - low
    weights = [-t + 2 * t**2 - t**3, 2 - 5 * t**2 + 3 * t**3, t + 4 * t**2 - 3 * t**3, -(t**2) + t**3]
    matrix = np.zeros((length, len(places)), dtype=np.float32)
    for offset, weight in zip((-1, 0, 1, 2), weights, strict=True):
        np.add.at(matrix, (np.clip(low + offset, 0, length - 1), np.arange(len(places))), weight / 2)
    return matrix


def constant_model(
    path: Path,
    outputs: dict[str, np.ndarray],
    *,
    image: Shape = (1, 3, 32, 64),
    focus: bool = False,
) -> Path:
    """A model that gives the same whatever it sees; with YOLOX's Focus at its beginning, or a plain layer."""
    first = (
        helper.make_node("Slice", ["image", "zero", "end", "axis", "two"], ["seen"])
        if focus
        else helper.make_node("Identity", ["image"], ["seen"])
    )
    nodes = [
        first,
        # What is seen is added times zero, or onnxruntime would drop the layer that looks.
        helper.make_node("ReduceMean", ["seen"], ["mean"], keepdims=0),
        helper.make_node("Mul", ["mean", "nothing"], ["none"]),
    ]
    constants = {"nothing": np.array(0, np.float32)}
    if focus:
        slices = {"zero": [0], "end": [2**31], "axis": [3], "two": [2]}
        constants |= {name: np.array(value, np.int64) for name, value in slices.items()}
    integers = []
    for name, value in outputs.items():
        if value.dtype.kind == "i":
            integers.append(name)
            nodes.append(helper.make_node("Identity", [f"{name}_value"], [name]))
            constants[f"{name}_value"] = value.astype(np.int64)
        else:
            nodes.append(helper.make_node("Add", [f"{name}_value", "none"], [name]))
            constants[f"{name}_value"] = value.astype(np.float32)
    shapes = {name: list(value.shape) for name, value in outputs.items()}
    return save(path, nodes, image=image, outputs=shapes, constants=constants, integers=integers)


def spots(
    size: tuple[int, int], places: dict[int, tuple[float, float]], *, sigma: float = 12.0, background: int = 0
) -> np.ndarray:
    """An RGB image with a bright spot for each colour channel."""
    rows, columns = np.mgrid[: size[1], : size[0]]
    image = np.full((size[1], size[0], 3), float(background))
    for channel, (x, y) in places.items():
        image[..., channel] += (255 - background) * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * sigma**2))
    return np.round(image).astype(np.uint8)
