"""The process's one OpenGL context, without a window: EGL, or else OSMesa.

PyOpenGL chooses its platform when first imported and cannot change it later. EGL is therefore
tried beforehand by ctypes: a context is made and dropped on each EGL device in turn, and the first
that can is the one. A PYOPENGL_PLATFORM in the environment is respected.

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
from types import ModuleType
from typing import Any, Protocol

import numpy as np

from poseviewer.errors import RendererUnavailableError

ADVICE = (
    "install EGL (Debian: libegl1 libgl1 libgl1-mesa-dri) or OSMesa (Debian: libosmesa6), "
    "or use the software renderer"
)

_EGL_PLATFORM_DEVICE_EXT = 0x313F
_EGL_OPENGL_API = 0x30A2
_EGL_CONFIG = (0x3033, 0x1, 0x3040, 0x8, 0x3025, 24, 0x3038)
"""A pbuffer surface, OpenGL, 24 bits of depth."""
_EGL_CONTEXT = (0x3098, 4, 0x30FB, 1, 0x30FD, 0x1, 0x3038)
"""OpenGL 4.1, core profile: what pyrender asks for."""
_OSMESA_CONTEXT = (0x22, 0x1908, 0x30, 24, 0x33, 0x34, 0x36, 3, 0x37, 3, 0)
"""RGBA, 24 bits of depth, OpenGL 3.3, core profile."""
_GL_UNSIGNED_BYTE = 0x1401


class Context(Protocol):
    """What pyrender's renderer needs around it."""

    def make_current(self) -> None:
        """Let OpenGL calls of this thread go to the context."""
        ...


_context: Context | None = None


def current_context() -> Context:
    """The context, made on the first call, in the thread that alone may use it.

    Raises:
        RendererUnavailableError: this machine gives no context; the message says what to install.
    """
    global _context
    if _context is None:
        platform, device = _choose_platform()
        os.environ["PYOPENGL_PLATFORM"] = platform
        try:
            _context = _OSMesaContext() if platform == "osmesa" else _egl_context(device)
            _context.make_current()
        except Exception as error:
            _context = None
            raise RendererUnavailableError(
                f"OpenGL by {platform} gave no context ({type(error).__name__}: {error}); {ADVICE}."
            ) from error
    return _context


def opengl_unavailable_reason() -> str | None:
    """Why there is no OpenGL here, in a sentence, or None. Makes the context if there is."""
    try:
        current_context()
    except RendererUnavailableError as error:
        return str(error)
    return None


def opengl_renderer_name() -> str | None:
    """What draws: the graphics card, or Mesa's own rasteriser; None where there is no OpenGL."""
    if opengl_unavailable_reason():
        return None
    current_context().make_current()
    from OpenGL import GL

    name: Any = GL.glGetString(GL.GL_RENDERER)
    return name.decode(errors="replace") if name else "unnamed"


def import_pyrender() -> ModuleType:
    """pyrender, imported once the platform is chosen, with third-party warnings kept in.

    Raises:
        RendererUnavailableError: this machine gives no context.
    """
    current_context()
    return _quiet_import()


def _quiet_import() -> ModuleType:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import pyrender
    return pyrender


def _choose_platform() -> tuple[str, int]:
    """The platform's name for PyOpenGL, and which EGL device."""
    chosen = os.environ.get("PYOPENGL_PLATFORM", "")
    if chosen not in ("", "egl", "osmesa"):
        raise RendererUnavailableError(
            f"PYOPENGL_PLATFORM is {chosen!r}; poseviewer draws without a window and needs "
            "egl or osmesa: unset it or set one of the two."
        )
    if not chosen and "OpenGL.platform" in sys.modules:
        raise RendererUnavailableError(
            "PyOpenGL was imported before poseviewer, for drawing into windows: "
            "set PYOPENGL_PLATFORM=egl (or osmesa) before the program starts."
        )
    device = None if chosen == "osmesa" else _working_egl_device()
    if device is not None:
        return "egl", device
    if chosen != "egl" and ctypes.util.find_library("OSMesa"):
        return "osmesa", 0
    wanted = chosen or "EGL and OSMesa"
    raise RendererUnavailableError(f"no OpenGL context here ({wanted} tried); {ADVICE}.")


def _working_egl_device() -> int | None:
    """The first EGL device that gives a context (EGL_DEVICE_ID, if set, is the only one tried)."""
    egl = _load_egl()
    if egl is None:
        return None
    devices = _egl_devices(egl)
    wanted = os.environ.get("EGL_DEVICE_ID", "")
    numbers = [int(wanted)] if wanted.isdigit() else range(len(devices))
    works = (n for n in numbers if n < len(devices) and _gives_context(egl, devices[n]))
    return next(works, None)


def _load_egl() -> Any:
    """libEGL, if it and libGL (whose functions PyOpenGL calls) are here."""
    if not ctypes.util.find_library("GL"):
        return None
    try:
        egl = ctypes.CDLL(ctypes.util.find_library("EGL") or "libEGL.so.1")
    except OSError:
        return None
    for name in ("eglGetProcAddress", "eglCreateContext"):
        getattr(egl, name).restype = ctypes.c_void_p
    return egl


def _egl_devices(egl: Any) -> list[int]:
    """Handles of the EGL devices; none where EGL cannot list them (pyrender needs that too)."""
    address = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
    if not address:
        return []
    query = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
    handles, count = (ctypes.c_void_p * 64)(), ctypes.c_int()
    if not query(address)(len(handles), handles, ctypes.byref(count)):
        return []
    return [handle for handle in handles[: count.value] if handle]


def _gives_context(egl: Any, device: int) -> bool:
    address = egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT")
    get = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_uint, ctypes.c_void_p, ctypes.c_void_p)
    display = ctypes.c_void_p(get(address)(_EGL_PLATFORM_DEVICE_EXT, device, None))
    if not display or not egl.eglInitialize(display, None, None):
        return False
    config, count = ctypes.c_void_p(), ctypes.c_int()
    try:
        wanted, attributes = _integers(_EGL_CONFIG), _integers(_EGL_CONTEXT)
        egl.eglBindAPI(_EGL_OPENGL_API)
        egl.eglChooseConfig(display, wanted, ctypes.byref(config), 1, ctypes.byref(count))
        if count.value < 1:
            return False
        context = ctypes.c_void_p(egl.eglCreateContext(display, config, None, attributes))
        if context:
            egl.eglDestroyContext(display, context)
        return bool(context)
    finally:
        egl.eglTerminate(display)


def _integers(values: tuple[int, ...]) -> Any:
    return (ctypes.c_int * len(values))(*values)


def _egl_context(device: int) -> Context:
    """Pyrender's own EGL context on a device; it needs no size, for framebuffers bring theirs."""
    _quiet_import()
    from pyrender.platforms import egl

    context = egl.EGLPlatform(1, 1, device=egl.get_device_by_index(device))
    context.init_context()
    return context


class _OSMesaContext:
    """A context in memory; drawing goes to framebuffers, so its own buffer is one pixel."""

    def __init__(self) -> None:
        _quiet_import()
        from OpenGL import platform

        self._mesa: Any = platform.PLATFORM.OSMesa  # pyright: ignore[reportAttributeAccessIssue]
        platform.PLATFORM.GetCurrentContext.restype = ctypes.c_void_p  # pyright: ignore
        self._mesa.OSMesaCreateContextAttribs.restype = ctypes.c_void_p
        self._mesa.OSMesaMakeCurrent.restype = ctypes.c_ubyte
        attributes = _integers(_OSMESA_CONTEXT)
        self._handle = ctypes.c_void_p(self._mesa.OSMesaCreateContextAttribs(attributes, None))
        self._buffer = np.zeros((1, 1, 4), np.uint8)

    def make_current(self) -> None:
        buffer = ctypes.c_void_p(self._buffer.ctypes.data)
        if not self._mesa.OSMesaMakeCurrent(self._handle, buffer, _GL_UNSIGNED_BYTE, 1, 1):
            raise RuntimeError("OSMesa did not make its context current")
