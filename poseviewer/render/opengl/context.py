"""The process's one OpenGL context, without a window: EGL, or else OSMesa.

PyOpenGL chooses its platform when first imported and cannot change it later: EGL where it lists a
device, else OSMesa. A PYOPENGL_PLATFORM in the environment is respected.

Mended here, as narrowly as can be (pyrender 0.1.45 pins PyOpenGL 3.1.0):

- PyOpenGL 3.1.0 does not know ``OSMesaCreateContextAttribs``: it is called by ctypes;
- its OSMesa context handles cannot be hashed, which it needs: they are read as integers.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import sys
import warnings
from typing import Any

import numpy as np

from poseviewer.errors import RendererUnavailableError

ADVICE = (
    "install EGL (Debian: libegl1 libgl1 libgl1-mesa-dri) or OSMesa (Debian: libosmesa6), "
    "or use the software renderer"
)
_OSMESA_CONTEXT = (0x22, 0x1908, 0x30, 24, 0x33, 0x34, 0x36, 3, 0x37, 3, 0)
"""RGBA, 24 bits of depth, OpenGL 3.3, core profile."""
_GL_UNSIGNED_BYTE = 0x1401

_context: Any = None


def opengl() -> Any:
    """PyOpenGL's functions, made to go to the process's context.

    The first call makes the context, in the thread that alone may use it.

    Raises:
        RendererUnavailableError: this machine gives no context; the message says what to install.
        RuntimeError: another thread made the context.
    """
    _make_context()
    from OpenGL import GL

    try:
        _context.make_current()
    except Exception as error:
        raise RuntimeError("the OpenGL context belongs to the thread that made it") from error
    return GL


def opengl_unavailable_reason() -> str | None:
    """Why there is no OpenGL here, in a sentence, or None. Makes the context if there is."""
    try:
        _make_context()
    except RendererUnavailableError as error:
        return str(error)
    return None


def opengl_renderer_name() -> str | None:
    """What draws: the graphics card, or Mesa's own rasteriser; None where there is no OpenGL."""
    if opengl_unavailable_reason():
        return None
    gl = opengl()
    name = gl.glGetString(gl.GL_RENDERER)
    return name.decode(errors="replace") if name else "unnamed"


def _make_context() -> None:
    global _context
    if _context is not None:
        return
    platform = os.environ["PYOPENGL_PLATFORM"] = _choose_platform()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import pyrender  # noqa: F401 - while its warnings are kept in
        context = _OSMesaContext() if platform == "osmesa" else _egl_context()
        context.make_current()
    except Exception as error:
        raise RendererUnavailableError(
            f"OpenGL by {platform} gave no context ({type(error).__name__}: {error}); {ADVICE}."
        ) from error
    _context = context


def _choose_platform() -> str:
    """The platform's name for PyOpenGL, which cannot change it once it is imported."""
    chosen = os.environ.get("PYOPENGL_PLATFORM", "")
    if chosen not in ("", "egl", "osmesa"):
        raise RendererUnavailableError(
            f"PYOPENGL_PLATFORM is {chosen!r}; poseviewer draws without a window and needs "
            "egl or osmesa: unset it or set one of the two."
        )
    if chosen:
        return chosen
    if "OpenGL.platform" in sys.modules:
        raise RendererUnavailableError(
            "PyOpenGL was imported before poseviewer, for drawing into windows: "
            "set PYOPENGL_PLATFORM=egl (or osmesa) before the program starts."
        )
    has = ctypes.util.find_library
    if has("EGL") and has("GL") and _has_egl_device():
        return "egl"
    if has("OSMesa"):
        return "osmesa"
    raise RendererUnavailableError(f"no OpenGL context here (EGL and OSMesa tried); {ADVICE}.")


def _has_egl_device() -> bool:
    """Whether EGL lists a device; pyrender needs that."""
    egl = ctypes.CDLL(ctypes.util.find_library("EGL"))
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    address, count = egl.eglGetProcAddress(b"eglQueryDevicesEXT"), ctypes.c_int()
    query = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
    return bool(address and query(address)(0, None, ctypes.byref(count)) and count.value)


def _egl_context() -> Any:
    """An EGL context on the first device that gives one, or on ``EGL_DEVICE_ID``."""
    from OpenGL.error import Error
    from pyrender.platforms import egl

    devices = egl.query_devices()
    wanted = os.environ.get("EGL_DEVICE_ID", "")
    failure: Exception = IndexError("EGL lists no such device")
    for device in [devices[int(wanted)]] if wanted.isdigit() else devices:
        context = egl.EGLPlatform(1, 1, device=device)  # framebuffers bring their own size
        try:
            context.init_context()
            return context
        except (AssertionError, Error) as error:
            failure = error
    raise failure


class _OSMesaContext:
    """A context in memory; drawing goes to framebuffers, so its own buffer is one pixel."""

    def __init__(self) -> None:
        from OpenGL import platform

        self._mesa: Any = platform.PLATFORM.OSMesa  # pyright: ignore[reportAttributeAccessIssue]
        platform.PLATFORM.GetCurrentContext.restype = ctypes.c_void_p  # pyright: ignore
        self._mesa.OSMesaCreateContextAttribs.restype = ctypes.c_void_p
        self._mesa.OSMesaMakeCurrent.restype = ctypes.c_ubyte
        attributes = (ctypes.c_int * len(_OSMESA_CONTEXT))(*_OSMESA_CONTEXT)
        self._handle = ctypes.c_void_p(self._mesa.OSMesaCreateContextAttribs(attributes, None))
        self._buffer = np.zeros((1, 1, 4), np.uint8)

    def make_current(self) -> None:
        """Let OpenGL calls of this thread go to the context."""
        buffer = ctypes.c_void_p(self._buffer.ctypes.data)
        if not self._mesa.OSMesaMakeCurrent(self._handle, buffer, _GL_UNSIGNED_BYTE, 1, 1):
            raise RuntimeError("OSMesa did not make its context current")
