"""Conversion to ONNX: operators beside their definitions."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest

from fitting_core.detect.mediapipe import tflite_file, tflite_to_onnx
from fitting_core.detect.mediapipe.networks import open_session
from fitting_core.detect.mediapipe.tflite_to_onnx import convert
from tests.fitting_core.detect.mediapipe.tflite_files import IMAGES, Level, Sparsity, TfliteWriter

RNG = np.random.default_rng(4)
HEIGHT, WIDTH, CHANNELS = SIZE = (6, 8, 3)

Expected = Callable[[np.ndarray], np.ndarray]
Case = Callable[[TfliteWriter], tuple[int, Expected]]
"""Adds operators; gives the output's number, and what it is of images by the operators' definition."""


def weights(*shape: int, kind: type = np.float32) -> np.ndarray:
    return RNG.normal(size=shape).astype(kind)


def same_pads(size: int, kernel: int, stride: int, dilation: int = 1) -> tuple[int, int]:
    total = max((-(-size // stride) - 1) * stride + (kernel - 1) * dilation + 1 - size, 0)
    return total // 2, total - total // 2


def convolved(images: np.ndarray, kernels: np.ndarray, *, stride: int = 1, same: bool = True) -> np.ndarray:
    """With kernels (out, rows, columns, in)."""
    rows, columns = kernels.shape[1:3]
    if same:
        sides = [same_pads(n, k, stride) for n, k in zip(images.shape[1:3], (rows, columns), strict=True)]
        images = np.pad(images, [(0, 0), *sides, (0, 0)])
    windows = np.lib.stride_tricks.sliding_window_view(images, (rows, columns), axis=(1, 2))[:, ::stride, ::stride]
    return np.einsum("nhwcij,oijc->nhwo", windows, kernels)


def convolution(net: TfliteWriter) -> tuple[int, Expected]:
    kernels, bias = weights(5, 3, 3, CHANNELS, kind=np.float16), weights(5, kind=np.float16)
    wide = [net.step(6, [net.constant(content)], content.shape) for content in (kernels, bias)]
    output = net.step(3, [IMAGES, *wide], (1, 3, 4, 5), f0=0, i1=2, i2=2, f3=3, i4=1, i5=1)
    return output, lambda images: np.clip(convolved(images, kernels.astype(float), stride=2) + bias, 0, 6)


def convolution_without_padding(net: TfliteWriter) -> tuple[int, Expected]:
    kernels, bias = weights(2, 3, 2, CHANNELS), np.zeros(2, np.float32)
    tensors = [net.constant(content) for content in (kernels, bias)]
    output = net.step(3, [IMAGES, *tensors], (1, 4, 7, 2), f0=1, i1=1, i2=1, f3=1, i4=1, i5=1)
    return output, lambda images: np.maximum(convolved(images, kernels, same=False), 0)


def depthwise_convolution(net: TfliteWriter) -> tuple[int, Expected]:
    kernels, bias = weights(1, 5, 5, CHANNELS), weights(CHANNELS)
    tensors = [net.constant(content) for content in (kernels, bias)]
    output = net.step(4, [IMAGES, *tensors], (1, 3, 4, CHANNELS), f0=0, i1=2, i2=2, i3=1, f4=0, i5=1, i6=1)

    def expected(images: np.ndarray) -> np.ndarray:
        each = [convolved(images[..., k : k + 1], kernels[..., k : k + 1], stride=2) for k in range(CHANNELS)]
        return np.concatenate(each, axis=-1) + bias

    return output, expected


SPARSE = Sparsity(
    order=[0, 1, 2, 3, 4, 5],
    blocks=[0, 3],
    levels=[
        Level(size=2),
        Level(size=1),
        Level(size=1),
        Level(segments=[0, 1, 3], indices=[1, 0, 1]),
        Level(size=2),
        Level(size=2),
    ],
)
"""Kernels (4, 1, 1, 4) in blocks of 2 x 2 outputs and inputs: three blocks are stored, the fourth is zero."""


def sparse_convolution(net: TfliteWriter) -> tuple[int, Expected]:
    stored = weights(12)
    dense = np.zeros((4, 1, 1, 4), np.float32)
    for block, (row, column) in zip(stored.reshape(3, 2, 2), [(0, 1), (1, 0), (1, 1)], strict=True):
        dense[2 * row : 2 * row + 2, 0, 0, 2 * column : 2 * column + 2] = block
    whole = net.step(124, [net.constant(stored, shape=dense.shape, sparsity=SPARSE)], dense.shape)
    first = np.eye(4, CHANNELS, dtype=np.float32)[:, None, None]
    none = net.constant(np.zeros(4, np.float32))
    four = net.step(3, [IMAGES, net.constant(first), none], (1, HEIGHT, WIDTH, 4), f0=0, i1=1, i2=1, i4=1, i5=1)
    output = net.step(3, [four, whole, none], (1, HEIGHT, WIDTH, 4), f0=0, i1=1, i2=1, i4=1, i5=1)
    return output, lambda images: convolved(convolved(images, first), dense)


def largest(net: TfliteWriter) -> tuple[int, Expected]:
    output = net.step(17, [IMAGES], (1, 3, 4, CHANNELS), f0=0, i1=2, i2=2, i3=2, i4=2, f5=0)
    return output, lambda images: images.reshape(len(images), 3, 2, 4, 2, CHANNELS).max((2, 4))


def padding_of_channels(net: TfliteWriter) -> tuple[int, Expected]:
    sides = np.array([[0, 0], [1, 2], [0, 1], [0, 2]], np.int32)
    output = net.step(34, [IMAGES, net.constant(sides)], (1, HEIGHT + 3, WIDTH + 1, CHANNELS + 2))
    return output, lambda images: np.pad(images, sides)


def sum_with_constant_and_prelu(net: TfliteWriter) -> tuple[int, Expected]:
    offset, slopes = weights(CHANNELS), weights(1, 1, CHANNELS)
    moved = net.step(0, [IMAGES, net.constant(offset)], (1, *SIZE), f0=0)
    bent = net.step(54, [moved, net.constant(slopes)], (1, *SIZE))
    output = net.step(0, [bent, IMAGES], (1, *SIZE), f0=1)

    def expected(images: np.ndarray) -> np.ndarray:
        moved = images + offset
        return np.maximum(np.where(moved < 0, moved * slopes, moved) + images, 0)

    return output, expected


def relu(net: TfliteWriter) -> tuple[int, Expected]:
    moved = net.step(0, [IMAGES, net.constant(np.full(CHANNELS, -0.5, np.float32))], (1, *SIZE), f0=0)
    return net.step(19, [moved], (1, *SIZE)), lambda images: np.maximum(images - 0.5, 0)


def enlarged(net: TfliteWriter) -> tuple[int, Expected]:
    size = np.array([2 * HEIGHT, 2 * WIDTH], np.int32)
    output = net.step(23, [IMAGES, net.constant(size)], (1, *size.tolist(), CHANNELS), f2=0, f3=1)
    return output, lambda images: np.stack([cv2.resize(image, (2 * WIDTH, 2 * HEIGHT)) for image in images])


def enlarged_by_corners(net: TfliteWriter) -> tuple[int, Expected]:
    size = np.array([2 * HEIGHT - 1, 2 * WIDTH - 1], np.int32)
    output = net.step(23, [IMAGES, net.constant(size)], (1, *size.tolist(), CHANNELS), f2=1, f3=0)

    def expected(images: np.ndarray) -> np.ndarray:
        rows = np.empty((len(images), 2 * HEIGHT - 1, WIDTH, CHANNELS))
        rows[:, ::2], rows[:, 1::2] = images, (images[:, 1:] + images[:, :-1]) / 2
        whole = np.empty((len(images), 2 * HEIGHT - 1, 2 * WIDTH - 1, CHANNELS))
        whole[:, :, ::2], whole[:, :, 1::2] = rows, (rows[:, :, 1:] + rows[:, :, :-1]) / 2
        return whole

    return output, expected


def depth_to_space(net: TfliteWriter) -> tuple[int, Expected]:
    kernels = weights(8, 1, 1, CHANNELS)
    tensors = [net.constant(kernels), net.constant(np.zeros(8, np.float32))]
    deep = net.step(3, [IMAGES, *tensors], (1, HEIGHT, WIDTH, 8), f0=0, i1=1, i2=1, i4=1, i5=1)
    output = net.step(5, [deep], (1, 2 * HEIGHT, 2 * WIDTH, 2), i0=2)

    def expected(images: np.ndarray) -> np.ndarray:
        deep = convolved(images, kernels).reshape(-1, HEIGHT, WIDTH, 2, 2, 2)
        return deep.transpose(0, 1, 3, 2, 4, 5).reshape(-1, 2 * HEIGHT, 2 * WIDTH, 2)

    return output, expected


def lists_in_one(net: TfliteWriter) -> tuple[int, Expected]:
    small = net.step(17, [IMAGES], (1, 3, 4, CHANNELS), f0=1, i1=2, i2=2, i3=2, i4=2)
    shapes = [(1, HEIGHT * WIDTH, CHANNELS), (1, 12, CHANNELS)]
    lists = [
        net.step(22, [tensor, net.constant(np.array(shape, np.int32))], shape)
        for tensor, shape in zip((IMAGES, small), shapes, strict=True)
    ]
    output = net.step(2, lists, (1, HEIGHT * WIDTH + 12, CHANNELS), i0=1)

    def expected(images: np.ndarray) -> np.ndarray:
        small = images.reshape(len(images), 3, 2, 4, 2, CHANNELS).max((2, 4))
        return np.concatenate([x.reshape(len(images), -1, CHANNELS) for x in (images, small)], axis=1)

    return output, expected


def probability(net: TfliteWriter) -> tuple[int, Expected]:
    matrix, bias = weights(2, CHANNELS), weights(2)
    axes = net.constant(np.array([1, 2], np.int32))
    mean = net.step(40, [IMAGES, axes], (1, 1, 1, CHANNELS), f0=1)
    linear = net.step(9, [mean, net.constant(matrix), net.constant(bias)], (1, 2), f0=0)
    output = net.step(14, [linear], (1, 2))
    return output, lambda images: 1 / (1 + np.exp(-(images.mean((1, 2)) @ matrix.T + bias)))


def mean_of_a_part(net: TfliteWriter) -> tuple[int, Expected]:
    bounds = [net.constant(np.array(values, np.int32)) for values in ([0, 1, 0, 0], [1, 5, 6, 3], [1, 2, 1, 1])]
    part = net.step(45, [IMAGES, *bounds], (1, 2, WIDTH, CHANNELS), i0=0, i1=4, i4=0)
    output = net.step(40, [part, net.constant(np.array([1, 2], np.int32))], (1, CHANNELS), f0=0)
    return output, lambda images: images[:, 1:5:2].mean((1, 2))


def row(net: TfliteWriter) -> tuple[int, Expected]:
    bounds = [net.constant(np.array(values, np.int32)) for values in ([0, 2, 0, 0], [1, 3, 8, 3], [1, 1, 1, 1])]
    output = net.step(45, [IMAGES, *bounds], (1, WIDTH, CHANNELS), i0=1, i1=1, i4=2)
    return output, lambda images: images[:, 2]


CASES: tuple[Case, ...] = (
    convolution, convolution_without_padding, depthwise_convolution, sparse_convolution, largest, padding_of_channels,
    sum_with_constant_and_prelu, relu, enlarged, enlarged_by_corners, depth_to_space, lists_in_one, probability,
    mean_of_a_part, row,
)  # fmt: skip


def images_for(count: int = 3) -> np.ndarray:
    return RNG.random((count, *SIZE)).astype(np.float32)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_operators_do_what_they_are_defined_to_do(case: Case, tmp_path: Path):
    net, images = TfliteWriter(SIZE), images_for()
    output, expected = case(net)
    source, target = net.write(tmp_path / "a.tflite", [output]), tmp_path / "a.onnx"
    convert(source, target)
    onnx.checker.check_model(str(target), full_check=True)
    found = np.asarray(open_session(target.read_bytes()).run(None, {"image": images})[0])
    np.testing.assert_allclose(found, expected(images), rtol=1e-5, atol=1e-5)


def test_every_operator_is_tried():
    used = set()
    for case in CASES:
        net = TfliteWriter(SIZE)
        case(net)
        used |= {tflite_file._OPERATORS[operator[0]] for operator in net.operators}
    assert used == set(tflite_to_onnx._OPERATORS) == set(tflite_file._OPERATORS.values())


def test_weights_stay_16_bit_floats(tmp_path: Path):
    net = TfliteWriter(SIZE)
    output, _ = convolution(net)
    convert(net.write(tmp_path / "a.tflite", [output]), tmp_path / "a.onnx")
    kinds = {tensor.data_type for tensor in onnx.load(str(tmp_path / "a.onnx")).graph.initializer if tensor.dims}
    assert kinds == {onnx.TensorProto.FLOAT16}


def test_files_that_are_none(tmp_path: Path):
    net = TfliteWriter(SIZE)
    path = net.write(tmp_path / "a.tflite", [net.step(25, [IMAGES], (1, *SIZE))])
    with pytest.raises(ValueError, match="an operator that tcfit does not know"):
        convert(path, tmp_path / "a.onnx")
    net = TfliteWriter(SIZE)
    whole = net.write(path, [relu(net)[0]]).read_bytes()
    for content, words in (
        (b"PK\3\4" + whole[4:], "damaged"),
        (b"", "is not a .tflite file"),
        (whole[:300], "damaged"),
    ):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=words):
            convert(path, tmp_path / "a.onnx")
    assert not (tmp_path / "a.onnx").exists()
