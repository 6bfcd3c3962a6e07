"""AMBF description files (ADF): the YAML text as checked sections of bodies and joints.

Versions 0.1 (written by the Blender add-on of 2019) to 1.0. A joint's ``parent`` and ``child`` name
a body by the key of its section (``BODY link1``, with the space). The body's name in ROS is the
section's ``name`` without spaces. Lengths are in m and angles in rad. An orientation is roll, pitch
and yaw about the fixed axes x, y, z in that order, as in URDF. AMBF's own readers are in
the simulator and in an add-on of Blender, not in a library.
"""

import math
import reprlib
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from app.files.bounded_io import read_bounded
from app.files.yaml_file import parse_yaml
from app.geometry import FloatArray
from app.robot.elements import AdfError

MAX_BYTES = 2 * 1024 * 1024
MAX_DEPTH = 24

_SHORT = reprlib.Repr()
_SHORT.maxlevel = 2  # aliases share a value: its full text can be exponentially long


@dataclass(frozen=True, slots=True)
class AdfSection:
    """One mapping of the file; ``place`` names it in messages."""

    place: str
    values: Mapping[Hashable, Any]

    def __contains__(self, key: str) -> bool:
        return self.values.get(key) is not None

    def text(self, key: str, default: str | None = None) -> str:
        """Return the string under ``key``, or ``default`` where the key is missing."""
        value = self.values.get(key, default)
        if not isinstance(value, str) or not value.strip():
            raise AdfError(f"{self.place}: {key!r} is {_SHORT.repr(value)}; expected a text")
        return value.strip()

    def number(self, key: Hashable, default: float | None = None) -> float:
        """Return the finite number under ``key``, or ``default`` where the key is missing."""
        value = self.values.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not _finite(value):
            raise AdfError(
                f"{self.place}: {key!r} is {_SHORT.repr(value)}; expected a finite number"
            )
        return float(value)

    def numbers(self, keys: Iterable[Hashable]) -> FloatArray:
        """Return the numbers under ``keys`` as (n,); each is required."""
        return np.array([self.number(key) for key in keys])

    def inside(self, key: str) -> "AdfSection":
        """Return the mapping under ``key``, or an empty one where it is missing."""
        return self._mapping(f"{self.place}: {key}", self.values.get(key))

    def entries(self, key: str) -> "list[AdfSection]":
        """Return the mappings of the list under ``key``, or none where it is missing."""
        entries = self.values.get(key) or []
        if not isinstance(entries, list):
            raise AdfError(f"{self.place}: {key!r} is {_SHORT.repr(entries)}; expected a list")
        place = f"{self.place}: {key}"
        return [self._mapping(f"{place}[{n}]", entry) for n, entry in enumerate(entries)]

    def pose(self, key: str) -> FloatArray:
        """Return ``position`` (m) and ``orientation`` under ``key`` as (4, 4)."""
        section, matrix = self.inside(key), np.eye(4)
        if "position" in section:
            matrix[:3, 3] = section.inside("position").numbers("xyz")
        if "orientation" in section:
            angles = section.inside("orientation").numbers("rpy")
            matrix[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
        return matrix

    def scale(self) -> FloatArray:
        """Return ``scale`` (3,): from a number, a list or x, y and z; 1 where it is missing."""
        value = self.values.get("scale")
        if isinstance(value, Mapping):
            scale = self.inside("scale").numbers("xyz")
        elif isinstance(value, list):
            section = AdfSection(f"{self.place}: scale", dict(enumerate(value)))
            scale = section.numbers(range(len(value)))
        else:
            scale = np.full(3, self.number("scale", 1.0))
        if scale.shape != (3,) or (scale == 0.0).any():
            raise AdfError(
                f"{self.place}: 'scale' is {_SHORT.repr(value)}; "
                "expected 1 or 3 numbers other than 0"
            )
        return scale

    @staticmethod
    def _mapping(place: str, value: Any) -> "AdfSection":
        if value is not None and not isinstance(value, Mapping):
            raise AdfError(f"{place} is {_SHORT.repr(value)}; expected a mapping")
        return AdfSection(place, value or {})


@dataclass(frozen=True, slots=True)
class AdfDocument:
    """Settings of the file, and bodies and joints by key in file order."""

    settings: AdfSection
    bodies: Mapping[str, AdfSection]
    joints: Mapping[str, AdfSection]


def read_adf(path: Path) -> AdfDocument:
    """Read the ADF at ``path``.

    Raises `AdfError` for a file that is not an ADF and for a listed section that is missing.
    """
    # Bytes, because the simulator's reader also accepts UTF-16.
    content = read_bounded(path, MAX_BYTES, AdfError)
    values = parse_yaml(content, path, max_depth=MAX_DEPTH, error=AdfError)
    if not isinstance(values, Mapping) or not values.get("bodies"):
        raise AdfError(f"{path} is not an ADF; expected a mapping with a list of 'bodies'")
    settings = AdfSection(str(path), values)
    return AdfDocument(settings, _sections(settings, "bodies"), _sections(settings, "joints"))


def _sections(settings: AdfSection, kind: str) -> dict[str, AdfSection]:
    keys = settings.values.get(kind) or []
    if not isinstance(keys, list) or not all(isinstance(key, str) for key in keys):
        raise AdfError(
            f"{settings.place}: {kind!r} is {_SHORT.repr(keys)}; expected a list of names"
        )
    sections = {}
    for key in keys:
        value = settings.values.get(key)
        if not isinstance(value, Mapping):
            raise AdfError(f"{settings.place} lists {key!r} in {kind!r}, but has no such section")
        if key in sections:
            raise AdfError(f"{settings.place} lists {key!r} twice in {kind!r}")
        sections[key] = AdfSection(f"{settings.place}: {key}", value)
    return sections


def _finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer too large for a float
        return False
