"""COLLADA as robots use it: strict about geometry, forgiving about everything else.

pycollada can be told to skip what is broken, but a part whose material refers to a missing
picture then vanishes with its geometry. So a file is read strictly, and when that fails once more
without anything but geometry and its places.
"""

import io
import math
import re
from pathlib import Path
from typing import Any

from collada.common import DaeError
from lxml import etree
from trimesh.exchange.dae import load_collada

from app.files.xml_guard import MAX_XML_BYTES, parse_xml, read_xml
from app.robot.errors import RobotMeshError

_NOT_A_NUMBER = re.compile(r"\S*[^-+.eE0-9\s]\S*")
_NODE_BYTES = 1000
"""What a node costs to place, as if it were text."""

_APPEARANCE = (
    *("bind_material", "library_materials", "library_effects", "library_images"),
    *("library_cameras", "library_lights", "instance_camera", "instance_light"),
    *("library_animations", "library_physics_models", "library_physics_scenes", "extra"),
)


def read_collada(path: Path) -> tuple[dict[str, Any], float]:
    """Read the scene as trimesh's keywords, and the metres that one unit of it is.

    Raises `RobotMeshError` for geometry that cannot be read whole, skinned meshes among it.
    """
    data = read_xml(path, RobotMeshError)
    root = parse_xml(data, path, RobotMeshError)
    if root.find(".//{*}visual_scene//{*}instance_controller") is not None:
        raise RobotMeshError(f"mesh {path} has a skinned or morphed part: rigid parts only")
    _check_positions(root, path)
    _check_size(root, path)
    unit = _unit(root, path)
    try:
        return _read_strictly(data), unit
    except DaeError:
        bare = etree.tostring(_without_appearance(root))
    try:
        return _read_strictly(bare), unit
    except DaeError as problem:
        raise RobotMeshError(f"mesh {path} cannot be read: {problem.msg}") from problem


def _read_strictly(data: bytes) -> dict[str, Any]:
    load: Any = load_collada  # has no types
    scene: dict[str, Any] = load(io.BytesIO(data), ignore_broken=False)
    return scene


def _without_appearance(root: etree._Element) -> etree._Element:
    for name in _APPEARANCE:
        for element in root.findall(f".//{{*}}{name}"):
            parent = element.getparent()
            if parent is not None:
                parent.remove(element)
    return root


def _check_positions(root: etree._Element, path: Path) -> None:
    """Refuse what pycollada reads as 0 (NaN) or stops at (text): both move vertices in silence."""
    sources = {element.get("id"): element for element in root.iterfind(".//{*}mesh/{*}source")}
    for used in root.iterfind(".//{*}mesh/{*}vertices/{*}input[@semantic='POSITION']"):
        source = sources.get((used.get("source") or "").removeprefix("#"))
        numbers = "" if source is None else source.findtext("{*}float_array") or ""
        foreign = _NOT_A_NUMBER.search(numbers)
        if foreign:
            raise RobotMeshError(
                f"mesh {path} has vertices that are not finite numbers: {foreign.group()!r}"
            )


def _check_size(root: etree._Element, path: Path) -> None:
    """Refuse a scene that is larger, with all its instances written out, than a file may be.

    A node may stand in others by its name, and these in others again: forty lines can stand for a
    million million triangles.
    """
    named = {f"#{node.get('id')}": node for node in root.iterfind(".//{*}node[@id]")}
    geometries = {f"#{each.get('id')}": each for each in root.iterfind(".//{*}geometry[@id]")}
    sizes: dict[etree._Element, int] = {}

    def size_of(element: etree._Element | None, above: frozenset[etree._Element]) -> int:
        if element is None:
            return 0
        if element in above:
            raise RobotMeshError(f"mesh {path} has a node {element.get('id')!r} that holds itself")
        if element not in sizes:
            above |= {element}
            size = _NODE_BYTES + sum(len(each.text or "") for each in element.iterfind(".//{*}p"))
            for child in element:
                tag, url = etree.QName(child).localname, child.get("url", "")
                if tag == "node":
                    size += size_of(child, above)
                elif tag == "instance_node":
                    size += size_of(named.get(url), above)
                elif tag == "instance_geometry":
                    size += size_of(geometries.get(url), above)
            sizes[element] = size
        return sizes[element]

    size = sum(size_of(scene, frozenset()) for scene in root.iterfind(".//{*}visual_scene"))
    if size > MAX_XML_BYTES:
        raise RobotMeshError(
            f"mesh {path} stands for {size} bytes with its instances written out: {MAX_XML_BYTES} "
            "allowed"
        )


def _unit(root: etree._Element, path: Path) -> float:
    """``<unit meter=...>``; 1 where the file does not say, as the format has it."""
    unit = root.find("{*}asset/{*}unit")
    text = "1" if unit is None else unit.get("meter", "1")
    try:
        metres = float(text)
    except ValueError:
        metres = math.nan
    if not 0.0 < metres < math.inf:
        raise RobotMeshError(f"mesh {path} has the unit {text!r}: a number of metres wanted")
    return metres
