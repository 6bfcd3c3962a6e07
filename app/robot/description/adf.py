"""AMBF description files (ADF): bodies and joints as they stand in the YAML, checked.

Versions 0.1 (written by the Blender add-on of 2019) to 1.0. A section is named by its key
(``BODY link1``, spaces and all), which is what a joint's ``parent`` and ``child`` say; what the
simulator calls the body in ROS is the section's ``name`` without its spaces. Lengths are m, angles
rad, an orientation is roll, pitch and yaw about the fixed axes x, y, z in that order (as in URDF).
"""

import math
import re
import reprlib
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from app.files.xml_guard import read_file
from app.geometry import FloatArray
from app.robot.errors import AdfError

MAX_BYTES = 2 * 1024 * 1024
MAX_DEPTH = 24

_NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
_READ_OTHERWISE = re.compile(r"[_:]|^[-+]?0[0-9xb]")
"""YAML 1.1, which is read here, has 8 for 010 and 90 for 1:30; the simulator's reader has not."""

_SHORT = reprlib.Repr()
_SHORT.maxlevel = 2  # aliases share a value, and its words would unfold


@dataclass(frozen=True, slots=True)
class Section:
    """One mapping of the file with the name of its place, for values and for messages."""

    place: str
    values: Mapping[Hashable, Any]

    def __contains__(self, key: str) -> bool:
        return self.values.get(key) is not None

    def text(self, key: str, default: str | None = None) -> str:
        """A string, or ``default`` where the key is missing."""
        value = self.values.get(key, default)
        if not isinstance(value, str) or not value.strip():
            raise AdfError(f"{self.place}: {key!r} is {_SHORT.repr(value)}: a text wanted")
        return value.strip()

    def number(self, key: Hashable, default: float | None = None) -> float:
        """A finite number, or ``default`` where the key is missing."""
        value = self.values.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not _finite(value):
            raise AdfError(f"{self.place}: {key!r} is {_SHORT.repr(value)}: a finite number wanted")
        return float(value)

    def numbers(self, keys: Iterable[Hashable]) -> FloatArray:
        """The numbers under ``keys``, all of them wanted."""
        return np.array([self.number(key) for key in keys])

    def inside(self, key: str) -> "Section":
        """The mapping under ``key``; an empty one where it is missing."""
        return self._mapping(f"{self.place}: {key}", self.values.get(key))

    def entries(self, key: str) -> "list[Section]":
        """The mappings of the list under ``key``; none where it is missing."""
        entries = self.values.get(key) or []
        if not isinstance(entries, list):
            raise AdfError(f"{self.place}: {key!r} is {_SHORT.repr(entries)}: a list wanted")
        place = f"{self.place}: {key}"
        return [self._mapping(f"{place}[{n}]", entry) for n, entry in enumerate(entries)]

    def pose(self, key: str) -> FloatArray:
        """``position`` (m) and ``orientation`` under ``key`` as (4, 4), the identity without."""
        section, matrix = self.inside(key), np.eye(4)
        if "position" in section:
            matrix[:3, 3] = section.inside("position").numbers("xyz")
        if "orientation" in section:
            angles = section.inside("orientation").numbers("rpy")
            matrix[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
        return matrix

    def scale(self) -> FloatArray:
        """``scale`` as (3,): a number, three of them, or x, y and z; 1 where it is missing."""
        value = self.values.get("scale")
        if isinstance(value, Mapping):
            scale = self.inside("scale").numbers("xyz")
        elif isinstance(value, list):
            section = Section(f"{self.place}: scale", dict(enumerate(value)))
            scale = section.numbers(range(len(value)))
        else:
            scale = np.full(3, self.number("scale", 1.0))
        if scale.shape != (3,) or (scale == 0.0).any():
            raise AdfError(
                f"{self.place}: 'scale' is {_SHORT.repr(value)}: "
                "one or 3 numbers other than 0 wanted"
            )
        return scale

    @staticmethod
    def _mapping(place: str, value: Any) -> "Section":
        if value is not None and not isinstance(value, Mapping):
            raise AdfError(f"{place} is {_SHORT.repr(value)}: a mapping wanted")
        return Section(place, value or {})


@dataclass(frozen=True, slots=True)
class AdfDocument:
    """The file's own settings, its bodies and its joints, each by its key, in file order."""

    settings: Section
    bodies: Mapping[str, Section]
    joints: Mapping[str, Section]


def read_adf(path: Path) -> AdfDocument:
    """Read the file; raise `AdfError` for what is no ADF, or names a section that it has not."""
    data = read_file(path, AdfError, max_bytes=MAX_BYTES)
    try:
        values = yaml.load(data, _StrictLoader)
    except (yaml.YAMLError, ValueError, RecursionError) as problem:
        reason = " ".join(str(problem).split())
        raise AdfError(f"{path} is not YAML that can be read: {reason}") from problem
    if not isinstance(values, Mapping) or not values.get("bodies"):
        raise AdfError(f"{path} is no ADF: a mapping with a list of 'bodies' wanted")
    settings = Section(str(path), values)
    return AdfDocument(settings, _sections(settings, "bodies"), _sections(settings, "joints"))


def _sections(settings: Section, kind: str) -> dict[str, Section]:
    keys = settings.values.get(kind) or []
    if not isinstance(keys, list) or not all(isinstance(key, str) for key in keys):
        raise AdfError(f"{settings.place}: {kind!r} is {_SHORT.repr(keys)}: a list of names wanted")
    sections = {}
    for key in keys:
        value = settings.values.get(key)
        if not isinstance(value, Mapping):
            raise AdfError(f"{settings.place} lists {key!r} in {kind!r} and has no such section")
        if key in sections:
            raise AdfError(f"{settings.place} lists {key!r} twice in {kind!r}")
        sections[key] = Section(f"{settings.place}: {key}", value)
    return sections


class _StrictLoader(yaml.SafeLoader):
    """A safe loader without double keys, merges (which can unfold without end) and deep nesting."""

    depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise yaml.YAMLError(f"nested deeper than {MAX_DEPTH} levels")
        node: yaml.Node | None = super().compose_node(parent, index)
        self.depth -= 1
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        names = [(key.tag, key.value) for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        if len(names) != len(node.value) or len(set(names)) != len(names):
            line = node.start_mark.line + 1
            raise yaml.YAMLError(f"the mapping in line {line} has a key twice, or one that is none")
        if any(tag == "tag:yaml.org,2002:merge" for tag, _ in names):
            raise yaml.YAMLError(f"a merge key (<<) in line {node.start_mark.line + 1}")
        return super().construct_mapping(node, deep)

    def construct_scalar(self, node: Any) -> Any:
        if node.tag in _NUMBERS and _READ_OTHERWISE.search(node.value):
            line = node.start_mark.line + 1
            raise yaml.YAMLError(f"{node.value[:60]!r} in line {line} is read in two ways")
        return super().construct_scalar(node)


def _finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond all floats
        return False
