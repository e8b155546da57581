"""Preparations before the import of pyrender, whose pinned libraries need them to work without a display."""

import ctypes
import os
import sys
from types import ModuleType
from typing import Any

BACKENDS = {"egl": "libegl1 libgl1", "osmesa": "libosmesa6"}
"""Ways to draw without a display, best first, with the Debian packages that each needs and that nothing else brings.

Found by installing packages one by one into a bare Debian 12: libegl1 brings Mesa's EGL, libgl1 brings its drivers and
the libGL that PyOpenGL looks functions up in.
"""
_OSMESA_CONSTANTS = {
    "OSMESA_DEPTH_BITS": 0x30,
    "OSMESA_PROFILE": 0x33,
    "OSMESA_CORE_PROFILE": 0x34,
    "OSMESA_CONTEXT_MAJOR_VERSION": 0x36,
    "OSMESA_CONTEXT_MINOR_VERSION": 0x37,
}


def use_backend(backend: str) -> None:
    """Choose the backend of BACKENDS for this process. Call it before anything imports OpenGL or pyrender."""
    os.environ["PYOPENGL_PLATFORM"] = backend
    _leave_out_viewer()
    if backend == "osmesa":
        _complete_osmesa()


def _leave_out_viewer() -> None:
    """Let `import pyrender` find an empty module in place of its window.

    The window's import loads pyglet, which needs libX11 and libXrender and fails on a machine without them.
    """
    viewer: Any = ModuleType("pyrender.viewer")
    viewer.Viewer = None
    sys.modules.setdefault("pyrender.viewer", viewer)


def _complete_osmesa() -> None:
    """Add what PyOpenGL 3.1.0, to which pyrender 0.1.45 is pinned, lacks for an OSMesa context of OpenGL 3.3.

    The constants and the signature are those of Mesa's osmesa.h. Later versions of PyOpenGL have them all.
    """
    from OpenGL import osmesa, platform
    from OpenGL.raw.osmesa._types import OSMesaContext

    if hasattr(osmesa, "OSMesaCreateContextAttribs"):
        return
    loaded: Any = vars(platform)["PLATFORM"]
    # PyOpenGL 3.1.0 keeps data by context, and its own pointer type cannot be a key.
    loaded.GetCurrentContext.restype = ctypes.c_void_p
    create = loaded.OSMesa.OSMesaCreateContextAttribs
    create.restype = OSMesaContext
    create.argtypes = [ctypes.POINTER(ctypes.c_int), OSMesaContext]

    def create_context(attributes: Any, shared: Any) -> Any:
        return create((ctypes.c_int * len(attributes))(*map(int, attributes)), shared)

    additions: dict[str, Any] = {"OSMesaCreateContextAttribs": create_context} | _OSMESA_CONSTANTS
    for name, value in additions.items():
        setattr(osmesa, name, value)
