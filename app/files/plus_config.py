"""Transforms and phantom landmarks of a PLUS configuration file."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from app.files.bounded_io import read_bounded
from app.files.landmarks import landmarks_by_name
from app.files.numbers import parse_numbers
from app.files.xml_guard import walk_xml
from app.geometry import (
    FloatArray,
    InputError,
    MarginGuardError,
    Transform,
    join_transform_name,
    snake_case,
)

_MAX_BYTES = 16_000_000
_ROOT = "PlusConfiguration"
_TRANSFORM = [_ROOT, "CoordinateDefinitions", "Transform"]
_LANDMARK = [_ROOT, "PhantomDefinition", "Geometry", "Landmarks", "Landmark"]


@dataclass(frozen=True, slots=True, eq=False)
class PlusConfiguration:
    """Transforms and landmarks of a PLUS configuration, with frames in ``lower_snake``.

    ``matrices``
        (target, source) to the text of a matrix. Not yet a `Transform`, because a configuration
        also holds scaled matrices (``ImageToProbe``).
    ``landmarks_mm``
        Name to position (3,) in the phantom's frame.
    """

    path: Path
    matrices: Mapping[tuple[str, str], str]
    landmarks_mm: Mapping[str, FloatArray]

    @property
    def tool(self) -> str | None:
        """The tool whose tip is calibrated (``ToolTipToTool``), None unless there is one."""
        found = [target for target, source in self.matrices if source == f"{target}_tip"]
        return found[0] if len(found) == 1 else None

    def affine(self, target: str, source: str) -> FloatArray:
        """Return the matrix (4, 4) of ``target_from_source``, which may be scaled.

        Raises `InputError` where it is missing or not 16 numbers.
        """
        if (target, source) not in self.matrices:
            given = ", ".join(join_transform_name(s, t) for t, s in self.matrices) or "none"
            raise InputError(
                f"{self.path} has no {join_transform_name(source, target)}; it has {given}"
            )
        numbers = parse_numbers(self.matrices[target, source], 16, self._place(target, source))
        return np.array(numbers).reshape(4, 4)

    def transform(self, target: str, source: str) -> Transform:
        """Return ``target_from_source``; raise `InputError` where it is missing or not rigid."""
        matrix = self.affine(target, source)
        try:
            return Transform.from_matrix(matrix, target=target, source=source)
        except MarginGuardError as error:
            raise InputError(f"{self._place(target, source)}: {error}") from error

    def _place(self, target: str, source: str) -> str:
        return f"{self.path}: matrix of {join_transform_name(source, target)}"


@dataclass(slots=True)
class _Walk:
    """Collects transforms and landmarks; ``tags`` is the path of the current element."""

    path: Path
    tags: list[str] = field(default_factory=list)
    matrices: dict[tuple[str, str], str] = field(default_factory=dict)
    landmarks: list[tuple[str, list[float]]] = field(default_factory=list)

    def start(self, name: str, attributes: dict[str, str]) -> None:
        self.tags.append(name)
        if self.tags == [name] and name != _ROOT:
            raise InputError(f"{self.path} is a {name[:60]!r}; expected a {_ROOT}")
        if self.tags == _TRANSFORM:
            self._transform(attributes)
        elif self.tags == _LANDMARK:
            label, position = attributes.get("Name", ""), attributes.get("Position", "")
            place = f"{self.path}: position of landmark {label!r}"
            self.landmarks.append((label, parse_numbers(position, 3, place)))

    def end(self, _: str) -> None:
        self.tags.pop()

    def _transform(self, attributes: dict[str, str]) -> None:
        source, target = (attributes.get(key, "") for key in ("From", "To"))
        try:
            edge = snake_case(target), snake_case(source)
        except MarginGuardError as error:
            raise InputError(
                f"{self.path}: Transform From={source!r} To={target!r}: {error}"
            ) from error
        if edge in self.matrices:
            raise InputError(f"{self.path}: {source}To{target} occurs twice")
        self.matrices[edge] = attributes.get("Matrix", "")


def read_plus_config(path: Path) -> PlusConfiguration:
    """Read the PLUS configuration at ``path``.

    Raises `InputError`, with the place, for another kind of file, a document type, and malformed
    transforms or landmarks.
    """
    walk = _Walk(path)
    walk_xml(read_bounded(path, _MAX_BYTES), path, start=walk.start, end=walk.end)
    return PlusConfiguration(path, walk.matrices, landmarks_by_name(walk.landmarks, path))
