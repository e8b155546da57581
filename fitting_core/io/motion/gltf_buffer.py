"""The binary data of a glTF file being written."""

import numpy as np
import pygltflib as gltf

_TYPES = {
    np.dtype(np.float32): gltf.FLOAT,
    np.dtype(np.uint32): gltf.UNSIGNED_INT,
    np.dtype(np.uint8): gltf.UNSIGNED_BYTE,
}
_SHAPES = {(): gltf.SCALAR, (3,): gltf.VEC3, (4,): gltf.VEC4, (16,): gltf.MAT4}


class Buffer:
    """The file's data, array by array."""

    def __init__(self, document: gltf.GLTF2) -> None:
        self._document, self._parts, self._size = document, [], 0

    def add(self, array: np.ndarray, target: int | None = None, *, bounds: bool = False) -> int:
        """Append an array; returns the number of its accessor."""
        array = np.ascontiguousarray(array)
        content = array.tobytes()
        document = self._document
        document.bufferViews.append(
            gltf.BufferView(buffer=0, byteOffset=self._size, byteLength=len(content), target=target)
        )
        accessor = gltf.Accessor(
            bufferView=len(document.bufferViews) - 1,
            componentType=_TYPES[array.dtype],
            count=len(array),
            type=_SHAPES[array.shape[1:]],
        )
        if bounds:
            accessor.min, accessor.max = (np.atleast_1d(f(array, 0)).tolist() for f in (np.min, np.max))
        document.accessors.append(accessor)
        padding = -len(content) % 4
        self._parts += [content, bytes(padding)]
        self._size += len(content) + padding
        return len(document.accessors) - 1

    def close(self) -> None:
        """Make this the document's buffer."""
        self._document.buffers = [gltf.Buffer(byteLength=self._size)]
        self._document.set_binary_blob(b"".join(self._parts))
