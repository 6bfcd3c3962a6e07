"""COLLADA as robots use it: strict about geometry, tolerant of errors elsewhere.

pycollada can ignore broken elements, but then drops a part with its geometry when the picture of
its material is missing. So a file is read strictly first. If that fails, it is read again with
nothing but geometry and node transforms.
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
from app.geometry import MarginGuardError

_NOT_A_NUMBER = re.compile(r"\S*[^-+.eE0-9\s]\S*")
_NODE_BYTES = 1000
"""Assumed size of a node, added to that of its text."""

_MAX_INDEX_BYTES = 24 * 1024 * 1024
"""Limit for the text of all corners with its instances written out. A triangle takes at least 6
bytes of text, mostly 20, and 200 bytes in memory."""

_MAX_OFFSET = 64
_MAX_POLYGON = 10_000
"""Limits for the offset of an input, and for the corners of a polygon."""

_APPEARANCE = (
    *("bind_material", "library_materials", "library_effects", "library_images"),
    *("library_cameras", "library_lights", "instance_camera", "instance_light"),
    *("library_animations", "library_physics_models", "library_physics_scenes", "extra"),
)


def read_collada(
    path: Path, error: type[MarginGuardError], max_bytes: int
) -> tuple[dict[str, Any], float]:
    """Read the scene as keywords of `trimesh.load_scene`, with its unit in metres.

    Raises ``error`` for geometry that cannot be read completely, which includes skinned meshes,
    and for a file of more than ``max_bytes``, or of too many triangles with its instances
    written out.
    """
    data = read_xml(path, error, max_bytes=min(max_bytes, MAX_XML_BYTES))
    root = parse_xml(data, path, error)
    if root.find(".//{*}visual_scene//{*}instance_controller") is not None:
        raise error(f"mesh {path} has a skinned or morphed part; expected rigid parts")
    _check_positions(root, path, error)
    _check_size(root, path, error)
    _check_polygons(root, path, error)
    unit = _unit(root, path, error)
    try:
        return _read_strictly(data), unit
    except DaeError:
        bare = etree.tostring(_without_appearance(root), encoding="utf-8")
    try:
        return _read_strictly(bare), unit
    except DaeError as problem:
        raise error(f"mesh {path} cannot be read: {problem.msg}") from problem


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


def _check_positions(root: etree._Element, path: Path, error: type[MarginGuardError]) -> None:
    """Refuse what pycollada reads as 0 (NaN) or stops at (text): both move vertices unnoticed."""
    sources = {element.get("id"): element for element in root.iterfind(".//{*}mesh/{*}source")}
    for used in root.iterfind(".//{*}mesh/{*}vertices/{*}input[@semantic='POSITION']"):
        source = sources.get((used.get("source") or "").removeprefix("#"))
        numbers = "" if source is None else source.findtext("{*}float_array") or ""
        foreign = _NOT_A_NUMBER.search(numbers)
        if foreign:
            raise error(
                f"mesh {path} has {foreign.group()!r} among its vertices, which is not finite"
            )


def _check_polygons(root: etree._Element, path: Path, error: type[MarginGuardError]) -> None:
    """Refuse counts that do not fit the corners: pycollada allocates what they add up to."""
    for inputs in root.iterfind(".//{*}input[@offset]"):
        offset = inputs.get("offset", "")
        if not (offset.isdecimal() and len(offset) < 9 and int(offset) <= _MAX_OFFSET):
            raise error(f"mesh {path} has the offset {offset!r}; expected 0 to {_MAX_OFFSET}")
    for polygons in root.iterfind(".//{*}polylist"):
        counts = (polygons.findtext("{*}vcount") or "").split()
        corners = len((polygons.findtext("{*}p") or "").split())
        offsets = [int(each.get("offset", "0")) for each in polygons.iterfind("{*}input")]
        if not all(count.isdecimal() and len(count) < 9 for count in counts):
            raise error(f"mesh {path} has a count of corners that is not a positive integer")
        numbers = [int(count) for count in counts]
        used = sum(numbers) * (max(offsets, default=0) + 1)
        if used != corners or max(numbers, default=0) > _MAX_POLYGON or 0 in numbers:
            raise error(
                f"mesh {path} has a polylist of {corners} indices; its counts of corners, each "
                f"from 1 to {_MAX_POLYGON}, need {used}"
            )


def _check_size(root: etree._Element, path: Path, error: type[MarginGuardError]) -> None:
    """Refuse a scene of too many corners with all its instances written out.

    A node may be instanced in others, and these in others again: 40 nodes can describe 10^12
    triangles.
    """
    named = {f"#{node.get('id')}": node for node in root.iterfind(".//{*}node[@id]")}
    geometries = {f"#{each.get('id')}": each for each in root.iterfind(".//{*}geometry[@id]")}
    sizes: dict[etree._Element, int] = {}

    def size_of(element: etree._Element | None, above: frozenset[etree._Element]) -> int:
        if element is None:
            return 0
        if element in above:
            raise error(f"mesh {path} has a node {element.get('id')!r} that contains itself")
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
    if size > _MAX_INDEX_BYTES:
        raise error(
            f"mesh {path} has {size} bytes with its instances written out; expected at most "
            f"{_MAX_INDEX_BYTES}"
        )


def _unit(root: etree._Element, path: Path, error: type[MarginGuardError]) -> float:
    """``<unit meter=...>``, by default 1 (COLLADA 1.4.1 specification, element ``unit``)."""
    unit = root.find("{*}asset/{*}unit")
    text = "1" if unit is None else unit.get("meter", "1")
    try:
        metres = float(text)
    except ValueError:
        metres = math.nan
    if not 0.0 < metres < math.inf:
        raise error(f"mesh {path} has the unit {text!r}; expected a number of metres")
    return metres
