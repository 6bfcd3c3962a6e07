"""Elements of a URDF as plain values, in the file's units: metres and radians.

Parses what a description needs of the text that `app.robot.description.urdf` has checked. Numbers
of elements that are not used here, such as masses, must be numbers, too. yourdfpy reads the same
values (the tests compare them), but loads trimesh and a graph library first, which takes a third of
the time in which a replay loads its program.
"""

from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from lxml import etree

from app.geometry import FloatArray

_Value = TypeVar("_Value")

_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_UNUSED_NUMBERS = {
    "calibration": ("rising", "falling"),
    "safety_controller": ("soft_lower_limit", "soft_upper_limit", "k_position", "k_velocity"),
}


@dataclass
class Box:
    """Edge lengths (3,)."""

    size: FloatArray


@dataclass
class Cylinder:
    """Radius, and length along z."""

    radius: float
    length: float


@dataclass
class Sphere:
    """A sphere around the origin."""

    radius: float


@dataclass
class Mesh:
    """A file; ``scale`` is (3,), one number for all axes, or None."""

    filename: str | None
    scale: float | FloatArray | None


@dataclass
class Geometry:
    """One of the shapes."""

    box: Box | None = None
    cylinder: Cylinder | None = None
    sphere: Sphere | None = None
    mesh: Mesh | None = None


@dataclass
class Color:
    """Red, green, blue and alpha."""

    rgba: FloatArray


@dataclass
class Material:
    """A material; ``color`` is None where only its name is given."""

    name: str | None
    color: Color | None


@dataclass
class Visual:
    """A shape for display at ``origin`` (4, 4), None for the identity."""

    geometry: Geometry
    origin: FloatArray | None
    material: Material | None


@dataclass
class Collision:
    """A shape for collision."""

    geometry: Geometry
    origin: FloatArray | None


@dataclass
class Inertial:
    """Mass in kg, and the inertia (3, 3) in kg m2 about ``origin`` (4, 4); None where not given.

    A moment that the tag omits is NaN.
    """

    mass: float | None
    inertia: FloatArray | None
    origin: FloatArray | None


@dataclass
class LinkElement:
    """A link, its shapes and its mass."""

    name: str
    visuals: list[Visual]
    collisions: list[Collision]
    inertial: Inertial | None


@dataclass
class Limit:
    """Limits of a joint; None where the tag omits them."""

    lower: float | None
    upper: float | None
    effort: float | None
    velocity: float | None


@dataclass
class Dynamics:
    """Losses of a joint; None where the tag omits them."""

    damping: float | None
    friction: float | None


@dataclass
class MimicElement:
    """The joint that another one follows."""

    joint: str
    multiplier: float
    offset: float


@dataclass
class JointElement:
    """A joint at ``origin`` (4, 4), None for the identity, with ``axis`` (3,)."""

    name: str
    type: str
    parent: str
    child: str
    origin: FloatArray | None
    axis: FloatArray
    limit: Limit | None
    mimic: MimicElement | None
    dynamics: Dynamics | None


@dataclass
class RobotElement:
    """The whole description."""

    name: str
    links: list[LinkElement] = field(default_factory=list)
    joints: list[JointElement] = field(default_factory=list)
    materials: list[Material] = field(default_factory=list)


def robot_element(root: etree._Element) -> RobotElement:
    """The values of ``<robot>``. Raises `ValueError` or `KeyError` for malformed numbers."""
    return RobotElement(
        root.attrib["name"],
        [_link(each) for each in root.findall("link")],
        [_joint(each) for each in root.findall("joint")],
        [_material(each) for each in root.findall("material")],
    )


def _link(element: etree._Element) -> LinkElement:
    return LinkElement(
        element.attrib["name"],
        [
            Visual(_geometry(each), _origin(each), _material_of(each))
            for each in element.findall("visual")
        ],
        [Collision(_geometry(each), _origin(each)) for each in element.findall("collision")],
        _inertial(element.find("inertial")),
    )


def _inertial(element: etree._Element | None) -> Inertial | None:
    if element is None:
        return None
    mass, inertia = element.find("mass"), element.find("inertia")
    tensor = None
    if inertia is not None:
        xx, xy, xz, yy, yz, zz = (float(inertia.get(name, "nan")) for name in _INERTIA)
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Inertial(None if mass is None else _number(mass, "value"), tensor, _origin(element))


def _joint(element: etree._Element) -> JointElement:
    _check_unused(element)
    axis, limit, mimic = (element.find(tag) for tag in ("axis", "limit", "mimic"))
    dynamics = element.find("dynamics")
    return JointElement(
        element.attrib["name"],
        element.attrib["type"],
        _required(element.find("parent")).attrib["link"],
        _required(element.find("child")).attrib["link"],
        _origin(element),
        np.array([1.0, 0.0, 0.0]) if axis is None else _numbers(axis, "xyz", "1 0 0"),
        None
        if limit is None
        else Limit(*(_number(limit, name) for name in ("lower", "upper", "effort", "velocity"))),
        None
        if mimic is None
        else MimicElement(
            mimic.attrib["joint"],
            float(mimic.get("multiplier", "1")),
            float(mimic.get("offset", "0")),
        ),
        None
        if dynamics is None
        else Dynamics(_number(dynamics, "damping"), _number(dynamics, "friction")),
    )


def _geometry(element: etree._Element) -> Geometry:
    shape = _required(element.find("geometry"))[0]
    if shape.tag == "box":
        size = shape.attrib["size"].replace(",", " ").split()
        return Geometry(box=Box(np.array(size, dtype=np.float64)))
    if shape.tag == "cylinder":
        radius, length = float(shape.attrib["radius"]), float(shape.attrib["length"])
        return Geometry(cylinder=Cylinder(radius, length))
    if shape.tag == "sphere":
        return Geometry(sphere=Sphere(float(shape.attrib["radius"])))
    return Geometry(mesh=Mesh(shape.get("filename"), _scale(shape.get("scale"))))


def _scale(text: str | None) -> float | FloatArray | None:
    numbers = [] if text is None else [float(each) for each in text.replace(",", " ").split()]
    if not numbers:
        return None
    return numbers[0] if len(numbers) == 1 else np.array(numbers)


def _origin(element: etree._Element) -> FloatArray | None:
    """The origin of ``element`` as a matrix (4, 4): fixed axes, roll first."""
    origin = element.find("origin")
    if origin is None:
        return None
    place = np.eye(4)
    place[:3, 3] = _numbers(origin, "xyz", "0 0 0")
    roll, pitch, yaw = _numbers(origin, "rpy", "0 0 0")
    (si, sj, sk), (ci, cj, ck) = np.sin([roll, pitch, yaw]), np.cos([roll, pitch, yaw])
    turn = np.eye(4)
    turn[0, :3] = cj * ck, sj * (si * ck) - ci * sk, sj * (ci * ck) + si * sk
    turn[1, :3] = cj * sk, sj * (si * sk) + ci * ck, sj * (ci * sk) - si * ck
    turn[2, :3] = -sj, cj * si, cj * ci
    return np.asarray(np.dot(place, turn))


def _material_of(visual: etree._Element) -> Material | None:
    element = visual.find("material")
    return None if element is None else _material(element)


def _material(element: etree._Element) -> Material:
    color = element.find("color")
    rgba = None if color is None else Color(_numbers(color, "rgba", "1 1 1 1"))
    return Material(element.get("name"), rgba)


def _check_unused(element: etree._Element) -> None:
    for tag, names in _UNUSED_NUMBERS.items():
        child = element.find(tag)
        for name in names if child is not None else ():
            _number(_required(child), name)


def _required(element: _Value | None) -> _Value:
    if element is None:
        raise ValueError("a required element is missing")
    return element


def _number(element: etree._Element, name: str) -> float | None:
    text = element.get(name)
    return None if text is None else float(text)


def _numbers(element: etree._Element, name: str, default: str) -> FloatArray:
    return np.array([float(each) for each in element.get(name, default).split()])
