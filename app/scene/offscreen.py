"""Errors of the scene, and drawing without a screen. Loads neither VTK nor Slicer."""

import ctypes
import os
import sys
from importlib.util import find_spec
from types import ModuleType

from app.geometry import MarginGuardError

_EGL = "libEGL.so.1"
_PLATFORM_DEVICE = 0x313F  # EGL_PLATFORM_DEVICE_EXT
_MAX_DEVICES = 32
_REMEDY = "install libegl1 and libgl1-mesa-dri (Debian, Ubuntu) to draw pictures without a screen"
_VIEWS = "trame_slicer.views"
_SERVER = ("trame_server", "trame_server.utils")


class SceneError(MarginGuardError):
    """Something that the scene cannot show: an unknown frame, a name that is taken."""


class OffscreenError(MarginGuardError):
    """This machine cannot draw without a screen; the message names what to install."""


def use_offscreen_rendering(library: str = _EGL) -> None:
    """Let all further render windows of this process draw into memory by EGL.

    Sets the environment variable that VTK reads. Checked first, because VTK ends the process where
    EGL is missing. Raises `OffscreenError` if the EGL ``library`` is missing or none of its devices
    starts.
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


def load_3d_view_only() -> None:
    """Let `trame_slicer.views` have no content of its own, only its submodules.

    Its ``__init__`` loads slice views with all of VTK, and the web server, which takes half a
    second of processor time. Call it before the first view; the process cannot serve pages then.
    """
    spec = find_spec(_VIEWS)
    if spec is None or _VIEWS in sys.modules or _SERVER[0] in sys.modules:
        return
    package = ModuleType(_VIEWS)
    package.__path__ = list(spec.submodule_search_locations or ())
    sys.modules[_VIEWS] = package
    # Used by a render scheduler that an offscreen view does not have.
    server, utils = (ModuleType(name) for name in _SERVER)
    utils.asynchronous = None  # type: ignore[attr-defined]
    server.utils = utils  # type: ignore[attr-defined]
    sys.modules.update(dict(zip(_SERVER, (server, utils), strict=True)))
