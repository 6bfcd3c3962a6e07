"""Checks of the machine: platform, Python, compilers, OpenGL without a screen.

``make`` runs this file alone, with the Python that the user chose, before an environment exists.
It therefore uses the standard library only, and runs under an old Python too.
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import platform
import shutil
import sys
import sysconfig
from collections.abc import Iterable
from typing import NamedTuple

OLDEST, NEWEST = (3, 11), (3, 13)


class Check(NamedTuple):
    """Result of one check, with one sentence on the remedy if it failed."""

    name: str
    ok: bool
    found: str
    remedy: str


def checked(name: str, ok: bool, found: str, remedy: str) -> Check:
    """A `Check` that has a remedy only if it failed."""
    return Check(name, ok, found, "" if ok else remedy)


def check_machine() -> list[Check]:
    """Check what MarginGuard runs on: platform, Python, OpenGL without a screen."""
    return [
        check_platform(platform.system(), platform.machine()),
        check_python(tuple(sys.version_info[:2])),
        check_egl(),
    ]


def check_building() -> list[Check]:
    """Check what ``make`` installs with: ``venv``, and the headers and compilers for messages."""
    return [check_venv(), check_headers(), check_compiler()]


def check_platform(system: str, machine: str) -> Check:
    """Check that the ROS and Slicer wheels exist for this platform."""
    return checked(
        "platform",
        (system, machine) == ("Linux", "x86_64"),
        f"{system} {machine}",
        "Linux on x86_64 is needed: the wheels of ROS 2 and of 3D Slicer exist for no other",
    )


def check_python(version: tuple[int, ...]) -> Check:
    """Check that every wheel exists for ``version`` (major, minor)."""
    oldest, newest, found = (".".join(map(str, v)) for v in (OLDEST, NEWEST, version))
    return checked(
        "python",
        OLDEST <= version <= NEWEST,
        found,
        f"Python {oldest} to {newest} is needed, this is {found}: "
        f"install python{oldest} and run `make PYTHON=python{oldest}`",
    )


def check_venv() -> Check:
    """Check that this Python can create a virtual environment with pip."""
    missing = [name for name in ("venv", "ensurepip") if importlib.util.find_spec(name) is None]
    return checked(
        "venv",
        not missing,
        f"without {' and '.join(missing)}" if missing else "with pip",
        "this Python cannot make a virtual environment: apt install python3-venv",
    )


def check_headers() -> Check:
    """Check that Python's headers are installed, which the interfaces are compiled with."""
    header = os.path.join(sysconfig.get_path("include"), "Python.h")  # noqa: PTH118
    return checked(
        "python headers",
        os.path.exists(header),  # noqa: PTH110
        header,
        f"{header} is missing, to compile the ROS interfaces with: apt install python3-dev",
    )


def check_compiler() -> Check:
    """Check that the compilers that setuptools calls exist (``CC`` and ``CXX`` are respected)."""
    programs = {
        role: os.environ.get(role) or sysconfig.get_config_var(role) or fallback
        for role, fallback in (("CC", "gcc"), ("CXX", "g++"))
    }
    paths = {name.split()[0]: shutil.which(name.split()[0]) for name in programs.values()}
    missing = [name for name, path in paths.items() if path is None]
    return checked(
        "compiler",
        not missing,
        ", ".join(path or f"no {name}" for name, path in paths.items()),
        f"{' and '.join(missing)} not found, to compile the ROS interfaces with: apt install g++",
    )


def check_egl() -> Check:
    """Check that pictures can be rendered without a screen: an EGL device initialises.

    Without one VTK crashes instead of raising, so this queries EGL itself as VTK does.
    """
    remedy = "pictures cannot be rendered without a screen: apt install libegl1 libgl1-mesa-dri"
    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError:
        return checked("egl", False, "libEGL.so.1 cannot be loaded", remedy)
    devices = _egl_devices(egl)
    if any(_egl_starts(egl, device) for device in devices):
        return checked("egl", True, f"{len(devices)} device(s)", remedy)
    return checked("egl", False, f"none of {len(devices)} device(s) starts", remedy)


def _egl_function(egl: ctypes.CDLL, name: str, restype: type, *argtypes: type) -> object:
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    address = egl.eglGetProcAddress(name.encode())
    return ctypes.CFUNCTYPE(restype, *argtypes)(address) if address else None


def _egl_devices(egl: ctypes.CDLL) -> list[int]:
    """Device handles of EGL_EXT_device_enumeration; none if EGL lacks it."""
    query = _egl_function(
        egl,
        "eglQueryDevicesEXT",
        ctypes.c_uint,
        ctypes.c_int,
        ctypes.POINTER(ctypes.c_void_p),
        ctypes.POINTER(ctypes.c_int),
    )
    handles, count = (ctypes.c_void_p * 16)(), ctypes.c_int()
    if query is None or not query(len(handles), handles, ctypes.byref(count)):  # type: ignore[operator]
        return []
    return [handle or 0 for handle in handles[: count.value]]


def _egl_starts(egl: ctypes.CDLL, device: int) -> bool:
    platform_device = 0x313F  # EGL_PLATFORM_DEVICE_EXT
    get_display = _egl_function(
        egl,
        "eglGetPlatformDisplayEXT",
        ctypes.c_void_p,
        ctypes.c_uint,
        ctypes.c_void_p,
        ctypes.c_void_p,
    )
    display = get_display(platform_device, device, None) if get_display else None  # type: ignore[operator]
    if not display:
        return False
    for name in ("eglInitialize", "eglTerminate"):
        getattr(egl, name).restype = ctypes.c_uint
    egl.eglInitialize.argtypes = [ctypes.c_void_p] * 3
    egl.eglTerminate.argtypes = [ctypes.c_void_p]
    started = bool(egl.eglInitialize(display, None, None))
    egl.eglTerminate(display)
    return started


def main(checks: Iterable[Check]) -> int:
    """Print one sentence for each failed check; return their number."""
    missing = [check for check in checks if not check.ok]
    for check in missing:
        print(f"marginguard: {check.remedy}", file=sys.stderr)
    return len(missing)


if __name__ == "__main__":
    os.environ.setdefault("EGL_LOG_LEVEL", "fatal")  # otherwise Mesa prints lines of its own
    sys.exit(1 if main(check_machine() + check_building()) else 0)
