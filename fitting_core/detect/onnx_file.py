"""ONNX files, as far as they are written or read here.

The package `onnx` does the same, but would have to be fetched for this alone, also where there is no network.
onnxruntime brings protobuf, whose messages these are.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

_OPSET, _IR_VERSION = 17, 9
"""Old enough for every onnxruntime that tcfit takes."""
_FLOAT = 1
TYPES: dict[type[np.generic], int] = {np.float32: _FLOAT, np.int64: 7, np.float16: 10}
"""ONNX's numbers for what tensors hold."""
_MESSAGES = {
    "Model": "ir_version 1 int64, producer_name 2 string, graph 7 Graph, opset_import 8 Opset*",
    "Opset": "version 2 int64",
    "Graph": "node 1 Node*, name 2 string, initializer 5 Tensor*, input 11 Value*, output 12 Value*",
    "Node": "input 1 string*, output 2 string*, name 3 string, op_type 4 string, attribute 5 Attribute*",
    "Attribute": "name 1 string, i 3 int64, s 4 bytes, ints 8 int64*, type 20 int64",
    "Tensor": "dims 1 int64*, data_type 2 int64, name 8 string, raw_data 9 bytes",
    "Value": "name 1 string, type 2 Type",
    "Type": "tensor_type 1 TensorType",
    "TensorType": "elem_type 1 int64, shape 2 Shape",
    "Shape": "dim 1 Dimension*",
    "Dimension": "dim_value 1 int64, dim_param 2 string",
}
"""Names, numbers and types of fields, as in onnx.proto3 (Apache-2.0); a * after those that repeat."""
Attribute = int | str | Sequence[int]


def _model() -> Any:
    """The class of the whole file's message."""
    file = descriptor_pb2.FileDescriptorProto(name="tcfit_onnx.proto", package="tcfit_onnx")
    for message, fields in _MESSAGES.items():
        of_message = file.message_type.add(name=message)
        for name, number, kind in (field.split() for field in fields.split(", ")):
            one = of_message.field.add(name=name, number=int(number), label=3 if kind.endswith("*") else 1)
            kind = kind.rstrip("*")
            if kind in _MESSAGES:
                one.type_name = f".tcfit_onnx.{kind}"
            else:
                one.type = descriptor_pb2.FieldDescriptorProto.Type.Value(f"TYPE_{kind.upper()}")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("tcfit_onnx.Model"))


Model = _model()


def onnx_bytes(
    nodes: Sequence[dict[str, Any]],
    weights: Mapping[str, np.ndarray],
    *,
    inputs: Mapping[str, Sequence[int | str]],
    outputs: Mapping[str, Sequence[int | str]],
) -> bytes:
    """An ONNX file.

    Args:
        nodes: Made by `node_of`, in the order in which they run.
        weights: Constant tensors by name.
        inputs: Shapes by name; a length that is a name may be any. Inputs and outputs are 32-bit floats.
        outputs: The same.
    """
    graph = {
        "node": nodes,
        "name": "mediapipe",
        "initializer": [_tensor(*weight) for weight in weights.items()],
        "input": [_value(*of) for of in inputs.items()],
        "output": [_value(*of) for of in outputs.items()],
    }
    opset = [{"version": _OPSET}]
    return Model(ir_version=_IR_VERSION, producer_name="tcfit", graph=graph, opset_import=opset).SerializeToString()


def node_of(operator: str, inputs: Sequence[str], output: str, attributes: Mapping[str, Attribute]) -> dict[str, Any]:
    """One step, which gives one tensor."""
    given = [_attribute(*attribute) for attribute in attributes.items()]
    return {"input": inputs, "output": [output], "name": output, "op_type": operator, "attribute": given}


def _attribute(name: str, value: Attribute) -> dict[str, Any]:
    if isinstance(value, int):
        return {"name": name, "i": value, "type": 2}
    if isinstance(value, str):
        return {"name": name, "s": value.encode(), "type": 3}
    return {"name": name, "ints": value, "type": 7}


def _tensor(name: str, value: np.ndarray) -> dict[str, Any]:
    content = np.ascontiguousarray(value, value.dtype.newbyteorder("<")).tobytes()
    return {"dims": value.shape, "data_type": TYPES[value.dtype.type], "name": name, "raw_data": content}


def _value(name: str, shape: Sequence[int | str]) -> dict[str, Any]:
    lengths = [{"dim_param": n} if isinstance(n, str) else {"dim_value": n} for n in shape]
    return {"name": name, "type": {"tensor_type": {"elem_type": _FLOAT, "shape": {"dim": lengths}}}}
