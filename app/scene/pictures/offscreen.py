"""Rendering without a screen by EGL. Checked first: VTK ends the process where EGL is missing."""

import ctypes
import os

from app.scene.errors import OffscreenError

_EGL = "libEGL.so.1"
_PLATFORM_DEVICE = 0x313F  # EGL_PLATFORM_DEVICE_EXT
_MAX_DEVICES = 32
_REMEDY = "install libegl1 and libgl1-mesa-dri (Debian, Ubuntu) to draw pictures without a screen"


def use_offscreen_rendering(library: str = _EGL) -> None:
    """Let all further render windows of this process draw into memory by EGL.

    Sets the environment variable that VTK reads. Raises `OffscreenError` if the EGL ``library`` is
    missing or none of its devices starts.
    """
    if not _any_device_starts(library):
        raise OffscreenError(f"{library}: no device starts; expected 1 or more: {_REMEDY}")
    os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = "vtkEGLRenderWindow"


def _any_device_starts(library: str) -> bool:
    """True if a device can be initialised as VTK does it: through EGL_EXT_device_base."""
    try:
        egl = ctypes.CDLL(library)
    except OSError as error:
        raise OffscreenError(f"{library}: not found: {_REMEDY}") from error
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    query = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
    display_of = egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT")
    if not query or not display_of:
        return False
    query_devices = ctypes.CFUNCTYPE(
        ctypes.c_uint, ctypes.c_int, ctypes.POINTER(ctypes.c_void_p), ctypes.POINTER(ctypes.c_int)
    )(query)
    get_display = ctypes.CFUNCTYPE(
        ctypes.c_void_p, ctypes.c_uint, ctypes.c_void_p, ctypes.c_void_p
    )(display_of)
    egl.eglInitialize.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]
    devices = (ctypes.c_void_p * _MAX_DEVICES)()
    count = ctypes.c_int(0)
    if not query_devices(_MAX_DEVICES, devices, ctypes.byref(count)):
        return False
    # Displays stay initialised: EGL shares them within the process, also with VTK.
    return any(
        egl.eglInitialize(get_display(_PLATFORM_DEVICE, device, None), None, None)
        for device in devices[: count.value]
    )
