"""MediaPipe's .tflite networks as ONNX, which onnxruntime runs everywhere.

Weights stay the 16-bit floats that the files hold (a Cast widens them, once, when onnxruntime opens the file), sparse
weights are made dense, and any number of images goes through at once. Images are N H W C at the border, as TFLite has
them, and N C H W inside, as ONNX wants them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fitting_core.detect.mediapipe.networks import IMAGES
from fitting_core.detect.mediapipe.tflite_file import Operator, TfliteFile, read_tflite
from fitting_core.detect.onnx_file import TYPES, Attribute, node_of, onnx_bytes

_SAME = 0
"""Padding that keeps the size, apart from strides; the other kind has none."""
_NO_ACTIVATION, _RELU, _RELU6 = 0, 1, 3
_TO_CHANNELS_FIRST, _TO_CHANNELS_LAST = (0, 3, 1, 2), (0, 2, 3, 1)
_AXES = {0: 0, 1: 2, 2: 3, 3: 1}
"""Where the axes of N H W C lie in N C H W."""
_END = 2**31 - 1


def convert(source: Path, target: Path) -> None:
    """Write a .tflite network as an ONNX file.

    Raises:
        ValueError: The network is damaged or has what MediaPipe's do not have; in words that follow its name.
        OSError: A file cannot be read or written.
    """
    target.write_bytes(onnx_of(read_tflite(source)))


def onnx_of(network: TfliteFile) -> bytes:
    """A network as the content of an ONNX file. Raises ValueError as `convert`."""
    graph = _Graph(network)
    if len(network.inputs) != 1 or len(graph.shape(network.inputs[0])) != 4:
        raise ValueError(f"has {len(network.inputs)} inputs, expected one of images")
    images = network.inputs[0]
    graph.emit("Transpose", [IMAGES], images, perm=_TO_CHANNELS_FIRST)
    for operator in network.operators:
        _OPERATORS[operator.name](graph, operator)
    for tensor in network.outputs:
        graph.give(tensor)
    return onnx_bytes(
        graph.nodes,
        graph.weights,
        inputs={IMAGES: graph.free_shape(images)},
        outputs={graph.network.tensors[tensor].name: graph.free_shape(tensor) for tensor in network.outputs},
    )


@dataclass
class _Graph:
    """The ONNX network under construction."""

    network: TfliteFile
    nodes: list[dict[str, Any]] = field(default_factory=list)
    weights: dict[str, np.ndarray] = field(default_factory=dict)
    names: dict[int, str] = field(default_factory=dict)
    """Of the tensors that have been computed, by number; those of four dimensions are N C H W."""
    constants: dict[int, np.ndarray] = field(default_factory=dict)
    """Content of tensors that only widen, or make dense, what is in the file."""

    def shape(self, tensor: int) -> tuple[int, ...]:
        """As in the file: one image, N H W C."""
        return self.network.tensors[tensor].shape

    def free_shape(self, tensor: int) -> list[int | str]:
        """The same for any number of images."""
        return ["N", *self.shape(tensor)[1:]]

    def constant(self, tensor: int) -> np.ndarray | None:
        """Constant content; None if computed."""
        return self.constants.get(tensor, self.network.tensors[tensor].constant)

    def known(self, tensor: int) -> np.ndarray:
        """Content that must be known."""
        content = self.constant(tensor)
        if content is None:
            raise ValueError(f"computes {self.network.tensors[tensor].name}, which was expected to be in the file")
        return content

    def weight(self, content: np.ndarray) -> str:
        """The name under which a constant can be used, as 32-bit floats or integers."""
        name = f"w{len(self.weights)}"
        self.weights[name] = content
        return self.emit("Cast", [name], to=TYPES[np.float32]) if content.dtype == np.float16 else name

    def integers(self, values: Sequence[int]) -> str:
        return self.weight(np.array(values, np.int64))

    def emit(self, operator: str, inputs: Sequence[str], tensor: int | None = None, **attributes: Attribute) -> str:
        """Add a step; its result is `tensor` from now on."""
        output = f"{operator}_{len(self.nodes)}"
        self.nodes.append(node_of(operator, inputs, output, attributes))
        if tensor is not None:
            self.names[tensor] = output
        return output

    def activate(self, tensor: int, kind: int) -> None:
        """Put what follows an operator within it behind it."""
        if kind == _RELU:
            self.emit("Relu", [self.names[tensor]], tensor)
        elif kind == _RELU6:
            limits = [self.weight(np.array(limit, np.float32)) for limit in (0, 6)]
            self.emit("Clip", [self.names[tensor], *limits], tensor)
        elif kind != _NO_ACTIVATION:
            raise ValueError(f"has an activation that tcfit does not know (number {kind})")

    def channels_last(self, tensor: int) -> str:
        """A tensor's name in the order of TFLite."""
        if len(self.shape(tensor)) != 4:
            return self.names[tensor]
        return self.emit("Transpose", [self.names[tensor]], perm=_TO_CHANNELS_LAST)

    def give(self, tensor: int) -> None:
        """Make a tensor an output, under its name in the file."""
        name = self.network.tensors[tensor].name
        self.nodes.append(node_of("Identity", [self.channels_last(tensor)], name, {}))


def _widened(graph: _Graph, operator: Operator) -> None:
    """16-bit weights, widened, and sparse ones, made dense: `weight` and the reader do that."""
    graph.constants[operator.outputs[0]] = graph.known(operator.inputs[0])


def _convolution(graph: _Graph, operator: Operator) -> None:
    _convolve(graph, operator, graph.known(operator.inputs[1]).transpose(0, 3, 1, 2), groups=1)


def _depthwise_convolution(graph: _Graph, operator: Operator) -> None:
    channels = graph.shape(operator.inputs[0])[3]
    _convolve(graph, operator, graph.known(operator.inputs[1]).transpose(3, 0, 1, 2), groups=channels)


def _convolve(graph: _Graph, operator: Operator, kernels: np.ndarray, *, groups: int) -> None:
    options = operator.options
    size = list(kernels.shape[2:])
    strides = (options["stride_height"], options["stride_width"])
    dilations = (options["dilation_height"], options["dilation_width"])
    inputs = [graph.names[operator.inputs[0]], graph.weight(kernels), *_bias(graph, operator)]
    graph.emit(
        "Conv",
        inputs,
        operator.outputs[0],
        kernel_shape=size,
        group=groups,
        strides=strides,
        dilations=dilations,
        pads=_pads(graph, operator, size, strides, dilations),
    )
    graph.activate(operator.outputs[0], options["activation"])


def _bias(graph: _Graph, operator: Operator) -> list[str]:
    return [graph.weight(graph.known(tensor)) for tensor in operator.inputs[2:] if tensor >= 0]


def _pads(
    graph: _Graph, operator: Operator, kernel: Sequence[int], strides: Sequence[int], dilations: Sequence[int]
) -> list[int]:
    """Rows and columns of zeros in front, then behind; an odd one lies behind."""
    if operator.options["padding"] != _SAME:
        return [0, 0, 0, 0]
    sides = zip(graph.shape(operator.inputs[0])[1:3], kernel, strides, dilations, strict=True)
    total = [max((-(-size // s) - 1) * s + (k - 1) * d + 1 - size, 0) for size, k, s, d in sides]
    before = [both // 2 for both in total]
    return before + [both - first for both, first in zip(total, before, strict=True)]


def _largest(graph: _Graph, operator: Operator) -> None:
    options = operator.options
    kernel, strides = (options["height"], options["width"]), (options["stride_height"], options["stride_width"])
    pads = _pads(graph, operator, kernel, strides, (1, 1))
    inputs = [graph.names[operator.inputs[0]]]
    graph.emit("MaxPool", inputs, operator.outputs[0], kernel_shape=kernel, strides=strides, pads=pads)
    graph.activate(operator.outputs[0], options["activation"])


def _fully_connected(graph: _Graph, operator: Operator) -> None:
    images = operator.inputs[0]
    flat = graph.names[images]
    if len(graph.shape(images)) == 4:
        _expect(graph.shape(images)[1:3] == (1, 1), "connects whole images fully")
        flat = graph.emit("Flatten", [flat])
    inputs = [flat, graph.weight(graph.known(operator.inputs[1])), *_bias(graph, operator)]
    graph.emit("Gemm", inputs, operator.outputs[0], transB=1)
    graph.activate(operator.outputs[0], operator.options["activation"])


def _padded(graph: _Graph, operator: Operator) -> None:
    images, rows, columns, channels = graph.known(operator.inputs[1]).tolist()
    before, behind = zip(images, channels, rows, columns, strict=True)
    graph.emit("Pad", [graph.names[operator.inputs[0]], graph.integers(before + behind)], operator.outputs[0])


def _resized(graph: _Graph, operator: Operator) -> None:
    options = operator.options
    mode = "align_corners" if options["align_corners"] else "half_pixel" if options["half_pixels"] else "asymmetric"
    _, *before, _ = graph.shape(operator.inputs[0])
    scales = graph.weight(np.array([1, 1, *graph.known(operator.inputs[1]) / before], np.float32))
    inputs = [graph.names[operator.inputs[0]], "", scales]
    graph.emit("Resize", inputs, operator.outputs[0], mode="linear", coordinate_transformation_mode=mode)


def _depth_to_space(graph: _Graph, operator: Operator) -> None:
    inputs = [graph.names[operator.inputs[0]]]
    graph.emit("DepthToSpace", inputs, operator.outputs[0], blocksize=operator.options["block"], mode="DCR")


def _sum(graph: _Graph, operator: Operator) -> None:
    rank = len(graph.shape(operator.outputs[0]))
    graph.emit("Add", [_addend(graph, tensor, rank) for tensor in operator.inputs], operator.outputs[0])
    graph.activate(operator.outputs[0], operator.options["activation"])


def _addend(graph: _Graph, tensor: int, rank: int) -> str:
    constant = graph.constant(tensor)
    if constant is None:
        _expect(len(graph.shape(tensor)) == rank, "adds tensors of different ranks")
        return graph.names[tensor]
    full = constant.reshape((1,) * (rank - constant.ndim) + constant.shape)
    return graph.weight(full.transpose(_TO_CHANNELS_FIRST) if rank == 4 else full)


def _prelu(graph: _Graph, operator: Operator) -> None:
    slopes = graph.weight(graph.known(operator.inputs[1]).transpose(2, 0, 1))
    graph.emit("PRelu", [graph.names[operator.inputs[0]], slopes], operator.outputs[0])


def _of_each(name: str) -> Callable[[_Graph, Operator], object]:
    return lambda graph, operator: graph.emit(name, [graph.names[operator.inputs[0]]], operator.outputs[0])


def _mean(graph: _Graph, operator: Operator) -> None:
    axes = sorted(axis % 4 for axis in np.atleast_1d(graph.known(operator.inputs[1])).tolist())
    _expect(axes == [1, 2], f"has a mean along the axes {axes}")
    inputs = [graph.names[operator.inputs[0]]]
    graph.emit("ReduceMean", inputs, operator.outputs[0], axes=(2, 3), keepdims=operator.options["keep"])


def _reshaped(graph: _Graph, operator: Operator) -> None:
    after = graph.shape(operator.outputs[0])
    _expect(after[0] == 1, "mixes images with each other")
    inputs = [graph.channels_last(operator.inputs[0]), graph.integers((-1, *after[1:]))]
    name = graph.emit("Reshape", inputs, operator.outputs[0])
    if len(after) == 4:
        graph.emit("Transpose", [name], operator.outputs[0], perm=_TO_CHANNELS_FIRST)


def _concatenated(graph: _Graph, operator: Operator) -> None:
    rank = len(graph.shape(operator.outputs[0]))
    axis = operator.options["axis"] % rank
    inputs = [graph.names[tensor] for tensor in operator.inputs]
    graph.emit("Concat", inputs, operator.outputs[0], axis=_AXES[axis] if rank == 4 else axis)
    graph.activate(operator.outputs[0], operator.options["activation"])


def _sliced(graph: _Graph, operator: Operator) -> None:
    options, rank = operator.options, len(graph.shape(operator.inputs[0]))
    begin, end, strides = (graph.known(tensor).tolist() for tensor in operator.inputs[1:4])
    begin = [0 if options["begin_mask"] >> axis & 1 else value for axis, value in enumerate(begin)]
    end = [_END if options["end_mask"] >> axis & 1 else value for axis, value in enumerate(end)]
    begin[0], end[0] = 0, _END  # all images
    gone = [axis for axis in range(rank) if options["shrink_mask"] >> axis & 1]
    inside = rank == 4 and not gone
    images = graph.names[operator.inputs[0]] if inside else graph.channels_last(operator.inputs[0])
    axes = [_AXES[axis] if inside else axis for axis in range(rank)]
    bounds = [graph.integers(values) for values in (begin, end, axes, strides)]
    name = graph.emit("Slice", [images, *bounds], operator.outputs[0])
    if gone:
        graph.emit("Squeeze", [name, graph.integers(gone)], operator.outputs[0])


def _expect(is_so: bool, otherwise: str) -> None:
    if not is_so:
        raise ValueError(f"{otherwise}, which MediaPipe's networks do not")


_OPERATORS: dict[str, Callable[[_Graph, Operator], object]] = {
    "ADD": _sum,
    "CONCATENATION": _concatenated,
    "CONV_2D": _convolution,
    "DENSIFY": _widened,
    "DEPTHWISE_CONV_2D": _depthwise_convolution,
    "DEPTH_TO_SPACE": _depth_to_space,
    "DEQUANTIZE": _widened,
    "FULLY_CONNECTED": _fully_connected,
    "LOGISTIC": _of_each("Sigmoid"),
    "MAX_POOL_2D": _largest,
    "MEAN": _mean,
    "PAD": _padded,
    "PRELU": _prelu,
    "RELU": _of_each("Relu"),
    "RESHAPE": _reshaped,
    "RESIZE_BILINEAR": _resized,
    "STRIDED_SLICE": _sliced,
}
"""Every operator of tflite_file.py."""
