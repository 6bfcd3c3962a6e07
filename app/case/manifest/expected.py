"""Expected results of a replay, with tolerances: ``expected.yaml``.

Every block is optional and checked only where it is given. Times are in seconds from the first
frame of the recording.
"""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import yaml

from app.case.manifest.key_rules import MATRIX, RIGID
from app.files.atomic_io import write_file
from app.files.declared import block_of
from app.files.document import Section
from app.files.keys import Block, Boolean, Choice, Frame, Integer, ListOf, Number, Numbers, Text
from app.geometry import InputError, Transform

DropoutKind = Literal["invalid", "missing"]

_SPAN_RULE = "end_s is start_s or later"
_Start = Annotated[float, Number("start, from the first frame")]
_End = Annotated[float, Number("end; the start or later")]


def _check_span(start_s: float, end_s: float, block: Section) -> None:
    if end_s < start_s:
        raise InputError(
            f"{block.place('end_s')} is {end_s:g}; expected start_s ({start_s:g}) or later"
        )


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedRegistration:
    """The true pose of the robot's base in the reference frame."""

    reference_from_base: Transform
    tolerance_mm: float
    tolerance_deg: float


@dataclass(frozen=True, slots=True)
class ExpectedBreach:
    """The tool is in the tumour from ``start_s`` to ``end_s``.

    ``shaft_only``: a part of the tool is inside, but not its tip.
    """

    start_s: _Start
    end_s: _End
    min_signed_distance_mm: Annotated[float, Number("depth, negative in the tumour")]
    shaft_only: Annotated[bool, Boolean("the tip stays outside", default=False)] = False

    def check(self, block: Section) -> None:
        """Raise `InputError` for an end before the start."""
        _check_span(self.start_s, self.end_s, block)


@dataclass(frozen=True, slots=True)
class ExpectedBreaches:
    """All breaches of the recording, in order; any other breach is a false one."""

    tolerance_ms: Annotated[float, Number("tolerance of start and end", minimum=0.0)]
    depth_tolerance_mm: Annotated[float, Number("tolerance of the depth", minimum=0.0)]
    intervals: Annotated[
        tuple[ExpectedBreach, ...],
        ListOf("the breaches", block_of(ExpectedBreach, "a breach", rules=(_SPAN_RULE,))),
    ]


_BREACHES = block_of(
    ExpectedBreaches, "all intervals in which the tool is in the tumour", optional=True
)


@dataclass(frozen=True, slots=True)
class ExpectedStructure:
    """All breaches of the further structure ``name``."""

    name: Annotated[str, Frame("name of the structure")]
    breaches: Annotated[
        ExpectedBreaches,
        replace(_BREACHES, description="all intervals in which the tool is in it", optional=False),
    ]


@dataclass(frozen=True, slots=True)
class ExpectedDropout:
    """``frame`` has no usable pose from ``start_s`` to ``end_s``."""

    frame: Annotated[str, Text("the frame without a usable pose")]
    kind: Annotated[DropoutKind, Choice("status of the samples, or none", ("invalid", "missing"))]
    start_s: _Start
    end_s: _End

    def check(self, block: Section) -> None:
        """Raise `InputError` for an end before the start."""
        _check_span(self.start_s, self.end_s, block)


EXPECTED = Block(
    "expected results of a replay; only what is given is checked",
    {
        "registration": Block(
            "the true registration of the robot's base",
            {
                "reference_from_base": Numbers(f"pose of the base in reference: {MATRIX}", 16),
                "tolerance_mm": Number("largest distance at the base's origin", minimum=0.0),
                "tolerance_deg": Number("largest angle", minimum=0.0),
            },
            optional=True,
            rules=(RIGID,),
        ),
        "breaches": _BREACHES,
        "structures": ListOf(
            "breaches of further structures",
            block_of(ExpectedStructure, "a structure"),
            optional=True,
        ),
        "dropouts": ListOf(
            "intervals in which the margin must be UNKNOWN",
            block_of(ExpectedDropout, "a dropout", rules=(_SPAN_RULE,)),
            optional=True,
        ),
        "frames": Integer("number of frames of the replay", 0, optional=True),
    },
)


@dataclass(frozen=True, slots=True)
class Expected:
    """The checks of a case; None and the empty tuple mean that a block is not given."""

    registration: ExpectedRegistration | None = None
    breaches: ExpectedBreaches | None = None
    dropouts: tuple[ExpectedDropout, ...] = ()
    frames: int | None = None
    structures: tuple[ExpectedStructure, ...] = ()


def load_expected(path: Path, *, reference: str, robot_base: str) -> Expected:
    """Read ``expected.yaml``; ``reference`` and ``robot_base`` name the registration's frames."""
    return read_expected(Section.load(path, EXPECTED), reference=reference, robot_base=robot_base)


def read_expected(document: Section, *, reference: str, robot_base: str) -> Expected:
    """Read a document with the keys of `EXPECTED`; see `load_expected`."""
    registration = None
    block: Section | None = document.value("registration")
    if block is not None:
        registration = ExpectedRegistration(
            block.matrix("reference_from_base", target=reference, source=robot_base),
            block.number("tolerance_mm"),
            block.number("tolerance_deg"),
        )
    return Expected(
        registration,
        document.value("breaches"),
        document.value("dropouts") or (),
        document.value("frames"),
        document.value("structures") or (),
    )


def write_expected(path: Path, expected: Expected) -> None:
    """Write ``expected`` atomically, so that `load_expected` reads the same values."""
    values = asdict(replace(expected, registration=None))
    if expected.registration is not None:
        pose = expected.registration.reference_from_base
        values["registration"] = {
            "reference_from_base": pose.matrix.ravel().tolist(),
            "tolerance_mm": expected.registration.tolerance_mm,
            "tolerance_deg": expected.registration.tolerance_deg,
        }
    document = {key: values[key] for key in EXPECTED.keys if values[key] not in (None, ())}
    write_file(path, yaml.safe_dump(document, sort_keys=False).encode())
