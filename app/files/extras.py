"""Extras of the distribution: which one brings a missing module, and how to install it."""

import re
from importlib.util import find_spec

from app.files.paths import checkout
from app.geometry import InputError

DISTRIBUTION = "marginguard"
GUIDE = "docs/installation.md"

OWN_MESSAGES = ("control_msgs", "marginguard_msgs", "tf2_msgs")
"""Packages of the wheel ``marginguard-interfaces``, which is compiled for each Python."""

_MODULES = {
    "cohort": re.compile(r"distributed|dask|pyarrow|fsspec|statsmodels"),
    "dicom": re.compile(r"highdicom|pydicom"),
    "hdf5": re.compile(r"h5py"),
    "notebook": re.compile(r"pandas|ipykernel"),
    "planning": re.compile(r"ompl|ruckig"),
    "ros": re.compile(r"rclpy|rosidl_\w+|\w+_(msgs|srvs|interfaces)"),
    "simulation": re.compile(r"mujoco|coacd"),
    "video": re.compile(r"av"),
    "volume": re.compile(r"SimpleITK"),
    "scene": re.compile(r"slicer(_core)?|vtk(modules)?|trame(_\w+)?|wslink|aiohttp|msgpack"),
}


def extra_with(module: str) -> str | None:
    """Extra that brings ``module`` (a dotted name): ``ros``; None if none does."""
    top = module.partition(".")[0]
    return next((extra for extra, names in _MODULES.items() if names.fullmatch(top)), None)


def install_command(extra: str = "") -> str:
    """Command that installs MarginGuard with ``extra``, in a checkout or from wheels."""
    name = f"[{extra}]" if extra else ""
    if checkout() is None:
        return f"pip install '{DISTRIBUTION}{name}'"
    return f"pip install -c constraints.txt -e '.{name}'"


def install_interfaces() -> str:
    """Instructions to install the compiled messages."""
    if checkout() is None:
        return f"install the wheel of marginguard-interfaces ({GUIDE})"
    return "install g++ and run `pip install -c constraints.txt ./interfaces`"


def install_hint(error: ImportError) -> str:
    """Instructions to install what ``error`` misses, or the command that checks everything."""
    name = error.name or ""
    if isinstance(error, ModuleNotFoundError) and name.partition(".")[0] in OWN_MESSAGES:
        return install_interfaces()
    extra = extra_with(name) if isinstance(error, ModuleNotFoundError) else None
    if extra is None:
        return "'marginguard doctor' lists what to install"
    run = f"run `{install_command(extra)}`"
    return f"{run} and {install_interfaces()}" if extra == "ros" else run


def check_installed(*modules: str, otherwise: str = "") -> None:
    """Raise `InputError` with the remedy for the first of ``modules`` that does not exist.

    ``otherwise`` is another remedy. Imports nothing: modules of the extras take seconds to load.
    """
    for module in modules:
        if find_spec(module) is None:
            missing = ModuleNotFoundError(f"{module} is not installed", name=module)
            remedies = filter(None, (install_hint(missing), otherwise))
            raise InputError(f"{missing}: {', or '.join(remedies)}")
