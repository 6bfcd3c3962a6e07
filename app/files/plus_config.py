"""What a calibration needs of a PLUS configuration: its transforms and its phantom's landmarks.

Walked by expat itself, which stops at a document type before it has read one declaration: entities,
which a PLUS file never has, cannot be expanded or fetched.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from app.files.bounded_io import read_small
from app.files.landmarks import checked_landmarks
from app.files.numbers import numbers_in
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
    """The parts of a PLUS configuration that are read, frames in our names.

    ``matrices``
        (target, source) to the text of a matrix. It becomes a `Transform` only when asked for:
        a configuration also holds scaled ones (``ImageToProbe``).
    ``landmarks_mm``
        Name to position (3,) in the phantom's frame.
    """

    path: Path
    matrices: Mapping[tuple[str, str], str]
    landmarks_mm: Mapping[str, FloatArray]

    def transform(self, target: str, source: str) -> Transform:
        """``target_from_source``; `InputError`, with what there is, when it is not given."""
        if (target, source) not in self.matrices:
            given = ", ".join(join_transform_name(s, t) for t, s in self.matrices) or "none"
            raise InputError(
                f"{self.path} has no {join_transform_name(source, target)}: {given} given"
            )
        place = f"{self.path}: matrix of {join_transform_name(source, target)}"
        matrix = numbers_in(self.matrices[target, source], 16, place)
        try:
            return Transform.from_matrix(matrix, target=target, source=source)
        except MarginGuardError as error:
            raise InputError(f"{place}: {error}") from error


@dataclass(slots=True)
class _Walk:
    path: Path
    at: list[str] = field(default_factory=list)
    matrices: dict[tuple[str, str], str] = field(default_factory=dict)
    landmarks: list[tuple[str, list[float]]] = field(default_factory=list)

    def refuse_doctype(self, *_: object) -> None:
        raise InputError(f"{self.path} has a document type (DOCTYPE): none is allowed")

    def start(self, name: str, attributes: dict[str, str]) -> None:
        self.at.append(name)
        if self.at == [name] and name != _ROOT:
            raise InputError(f"{self.path} is a {name[:60]!r}: a {_ROOT} wanted")
        if self.at == _TRANSFORM:
            self._transform(attributes)
        elif self.at == _LANDMARK:
            self._landmark(attributes)

    def end(self, _: str) -> None:
        self.at.pop()

    def _transform(self, attributes: dict[str, str]) -> None:
        source, target = (attributes.get(key, "") for key in ("From", "To"))
        try:
            edge = snake_case(target), snake_case(source)
        except MarginGuardError as error:
            raise InputError(
                f"{self.path}: Transform From={source!r} To={target!r}: {error}"
            ) from error
        if edge in self.matrices:
            raise InputError(f"{self.path}: {source}To{target} stands twice")
        self.matrices[edge] = attributes.get("Matrix", "")

    def _landmark(self, attributes: dict[str, str]) -> None:
        name, position = attributes.get("Name", ""), attributes.get("Position", "")
        place = f"{self.path}: position of landmark {name!r}"
        self.landmarks.append((name, numbers_in(position, 3, place)))


def read_plus_config(path: Path) -> PlusConfiguration:
    """Read the PLUS configuration at ``path``.

    Raises `InputError`, with the place, for a file that is none, one with a document type, and
    transforms or landmarks that are not what they should be.
    """
    content = read_small(path, _MAX_BYTES)
    walk = _Walk(path)
    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = walk.refuse_doctype
    parser.StartElementHandler = walk.start
    parser.EndElementHandler = walk.end
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise InputError(f"{path} is not well-formed XML: {error}") from error
    return PlusConfiguration(path, walk.matrices, checked_landmarks(walk.landmarks, path))
