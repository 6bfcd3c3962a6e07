"""Reads a URDF: strict checks, then its elements by yourdfpy, in the file's metres and radians.

yourdfpy repeats a single number, ignores a fourth one, keeps the last of two links of one name,
gives a moment of inertia that is missing the value 1, and leaves the losses of joints as text. So
every ambiguity is refused here before.

``.xacro`` files become URDF by the xacro package, in a process of its own with limits. xacro
evaluates Python expressions (``${...}``, ``$(eval ...)``). It hides the builtins from them, but
this is not a sandbox: a xacro file is code. So only a file that the user names is expanded, never a
text from the network, and the process has limits of time and memory (`xacro_child`). Included
files, those of ``xacro.load_yaml`` too, must lie, with links followed, in the folder of the file's
package (its own folder where it has none) or in that of a package found by ``$(find ...)``.
Document types are refused.
"""

import json
import os
import signal
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from lxml import etree

from app.files.child_process import Ask, ChildError, ask
from app.files.xml_guard import check_xml, parse_xml, read_xml
from app.robot.elements import UrdfError

if TYPE_CHECKING:
    from yourdfpy import Robot


MAX_URDF_BYTES = 16 * 1024 * 1024
GEOMETRIES = ("mesh", "box", "cylinder", "sphere")
_COUNTS = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "limit": {"lower": 1, "upper": 1},
    "mimic": {"multiplier": 1, "offset": 1},
    "box": {"size": 3},
    "cylinder": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
}
"""Count of numbers per attribute."""

_ONCE = ("parent", "child", "origin", "axis", "limit", "mimic")
_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_XACRO = "http://www.ros.org/wiki/xacro"


def read_urdf(path: Path) -> "Robot":
    """Read the file at ``path``: see `parse_urdf`."""
    return _parse(read_xml(path, UrdfError, max_bytes=MAX_URDF_BYTES), path)


def parse_urdf(data: bytes, name: Path | str, *, max_bytes: int = MAX_URDF_BYTES) -> "Robot":
    """Parse the text of a URDF; ``name`` is for messages.

    Every joint of the result has a type, a parent and a child; revolute and prismatic ones have
    limits (``lower`` and ``upper`` are 0 where the tag omits them, as in urdfdom). A moment of
    inertia that the file omits is NaN. Raises `UrdfError` for anything malformed or ambiguous.
    """
    if len(data) > max_bytes:
        raise UrdfError(f"{name} has {len(data)} bytes; expected at most {max_bytes}")
    check_xml(data, name, UrdfError)
    return _parse(data, name)


def _parse(data: bytes, path: Path | str) -> "Robot":
    root = parse_xml(data, path, UrdfError)
    _check_root(root, path)
    for kind in ("link", "joint"):
        _check_names(root, kind, path)
    for shape in root.iterfind("link/*"):
        if shape.tag in ("visual", "collision"):
            _check_geometry(shape, path)
    for origin in root.iterfind("link/inertial/origin"):
        _check_numbers(origin, path)
    for joint in root.iterfind("joint"):
        _check_joint(joint, path)
    try:
        with np.errstate(all="ignore"):  # poses that are not finite are refused later
            return _elements(root)
    except (ValueError, KeyError) as problem:  # malformed numbers, missing attributes
        reason = " ".join(str(problem).split())
        raise UrdfError(f"{path} cannot be read as URDF: {reason}") from problem


def _elements(root: etree._Element) -> "Robot":
    """The values of the checked ``root``; numbers that are malformed raise `ValueError`.

    Not by `yourdfpy.URDF.load`, which parses the text again, and recovers what it can of a text
    that its parser refuses.
    """
    from yourdfpy import URDF  # slow to load: trimesh and networkx

    for inertia in root.iterfind("link/inertial/inertia"):
        for name in _MOMENTS:
            inertia.set(name, inertia.get(name, "nan"))
    robot = URDF._parse_robot(root)
    for joint in robot.joints:
        for name in ("damping", "friction"):
            if (text := getattr(joint.dynamics, name, None)) is not None:
                setattr(joint.dynamics, name, float(text))
    return robot


def _check_root(root: etree._Element, path: Path | str) -> None:
    if root.tag != "robot":
        raise UrdfError(f"{path} holds <{root.tag}> in line {root.sourceline}; expected <robot>")
    if not root.get("name"):
        raise UrdfError(f"{path}: <robot> in line {root.sourceline} has no name")
    for element in root.iter():
        if isinstance(element.tag, str) and element.tag.startswith(f"{{{_XACRO}}}"):
            raise UrdfError(
                f"{path} has a xacro element in line {element.sourceline}; "
                "expected a file that xacro has expanded"
            )
    if root.find("link") is None:
        raise UrdfError(f"{path} has no link; expected at least one")


def _check_names(root: etree._Element, kind: str, path: Path | str) -> None:
    lines: dict[str, int] = {}
    for element in root.iterfind(kind):
        name, line = element.get("name"), element.sourceline or 0
        if not name:
            raise UrdfError(f"{path}: <{kind}> in line {line} has no name")
        if name in lines:
            raise UrdfError(
                f"{path} has two {kind}s named {name!r}, in the lines {lines[name]} and {line}; "
                "expected different names"
            )
        lines[name] = line


def _check_geometry(shape: etree._Element, path: Path | str) -> None:
    place = f"{path}: <{shape.tag}> in line {shape.sourceline}"
    geometry = shape.find("geometry")
    tags = [] if geometry is None else [child.tag for child in geometry]
    if len(tags) != 1 or tags[0] not in GEOMETRIES:
        found = ", ".join(map(str, tags)) or "none"
        raise UrdfError(
            f"{place} has the geometry {found}; expected one of {', '.join(GEOMETRIES)}"
        )
    if tags[0] == "mesh" and not shape.findall("geometry/mesh[@filename]"):
        raise UrdfError(f"{place} has a mesh without filename")
    for element in (*shape.iterfind("origin"), *shape.iterfind("geometry/*")):
        _check_numbers(element, path)


def _check_numbers(element: etree._Element, path: Path | str) -> None:
    for name, count in _COUNTS.get(str(element.tag), {}).items():
        text = element.get(name)
        if text is not None and (len(text.split()) != count or "_" in text):
            raise UrdfError(
                f"{path}: {name!r} of <{element.tag}> in line {element.sourceline} is "
                f"{text[:60]!r}; expected {count} decimal numbers"
            )


def _check_joint(joint: etree._Element, path: Path | str) -> None:
    place = f"{path}: joint {joint.get('name')!r} in line {joint.sourceline}"
    for tag in _ONCE:
        found = joint.findall(tag)
        if len(found) > 1:
            raise UrdfError(f"{place} has {len(found)} elements <{tag}>; expected one")
        for element in found:
            _check_numbers(element, path)
    for role in ("parent", "child"):
        element = joint.find(role)
        if element is None or not element.get("link"):
            raise UrdfError(f"{place} names no {role} link")
    kind = joint.get("type")
    if kind not in ("fixed", "revolute", "continuous", "prismatic"):
        raise UrdfError(
            f"{place} has the type {kind!r}; expected fixed, revolute, continuous or prismatic"
        )
    if kind in ("revolute", "prismatic") and joint.find("limit") is None:
        raise UrdfError(f"{place} has no <limit>; expected one for a {kind} joint")
    mimic = joint.find("mimic")
    if mimic is not None and not mimic.get("joint"):
        raise UrdfError(f"{place} has a <mimic> that names no joint")


MAX_CPU_S = 1.5
"""Limit for the processor time of an expansion; those of real robots take 0.05 to 0.5 s."""

MAX_WALL_S = 30.0
"""Limit for the time of an expansion on a machine that is busy with other things."""

_ASK = partial(ask, "app.robot.xacro_child", max_s=MAX_WALL_S)


def expand_xacro(
    path: Path,
    arguments: Mapping[str, str],
    package_dirs: Sequence[str | Path] = (),
    *,
    ask: Ask = _ASK,
) -> bytes:
    """Expand the xacro file at ``path`` to URDF.

    ``arguments`` are the values of its ``<xacro:arg>``. ``package_dirs`` are the folders of
    ``$(find NAME)``. Raises `UrdfError` when the expansion fails, or exceeds a limit of
    `xacro_child`.
    """
    request = {
        "path": str(path.absolute()),
        "arguments": dict(arguments),
        "package_dirs": [os.fspath(entry) for entry in package_dirs],
        "max_bytes": MAX_URDF_BYTES,
        "max_cpu_s": MAX_CPU_S,
    }
    try:
        status, reply = ask(json.dumps(request).encode())
    except ChildError as problem:
        raise UrdfError(f"{path} cannot be expanded: xacro {problem}") from problem
    if status == -signal.SIGPROF:
        raise UrdfError(
            f"{path} cannot be expanded: it takes more than {MAX_CPU_S:g} s of processor time; "
            "expand a large file once by 'xacro' and give the URDF"
        )
    if status != 0 or reply[:1] not in (b"U", b"E"):
        raise UrdfError(f"{path} cannot be expanded: xacro ended with status {status}")
    if reply[:1] == b"E":
        raise UrdfError(reply[1:].decode("utf-8", "replace"))
    return reply[1:]
