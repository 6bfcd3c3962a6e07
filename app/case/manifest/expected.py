"""Expected results of a replay, with tolerances: ``expected.yaml``.

Every block is optional and checked only where it is given. Times are in seconds from the first
frame of the recording.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import yaml

from app.case.manifest.key_rules import MATRIX, RIGID
from app.files.atomic_io import write_file
from app.files.document import Section
from app.files.keys import Block, Boolean, Choice, Integer, ListOf, Number, Numbers, Text
from app.geometry import InputError, MarginGuardError, Transform

DropoutKind = Literal["invalid", "missing"]

_SPAN = {
    "start_s": Number("start, from the first frame"),
    "end_s": Number("end; the start or later"),
}
_SPAN_RULE = "end_s is start_s or later"

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
        "breaches": Block(
            "all intervals in which the tool is in the tumour",
            {
                "tolerance_ms": Number("tolerance of start and end", minimum=0.0),
                "depth_tolerance_mm": Number("tolerance of the depth", minimum=0.0),
                "intervals": ListOf(
                    "the breaches",
                    Block(
                        "a breach",
                        {
                            **_SPAN,
                            "min_signed_distance_mm": Number("depth, negative in the tumour"),
                            "shaft_only": Boolean("the tip stays outside", default=False),
                        },
                        rules=(_SPAN_RULE,),
                    ),
                ),
            },
            optional=True,
        ),
        "dropouts": ListOf(
            "intervals in which the margin must be UNKNOWN",
            Block(
                "a dropout",
                {
                    "frame": Text("the frame without a usable pose"),
                    "kind": Choice("status of the samples, or none", ("invalid", "missing")),
                    **_SPAN,
                },
                rules=(_SPAN_RULE,),
            ),
            optional=True,
        ),
        "frames": Integer("number of frames of the replay", 0, optional=True),
    },
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

    start_s: float
    end_s: float
    min_signed_distance_mm: float
    shaft_only: bool = False


@dataclass(frozen=True, slots=True)
class ExpectedBreaches:
    """All breaches of the recording, in order; any other breach is a false one."""

    tolerance_ms: float
    depth_tolerance_mm: float
    intervals: tuple[ExpectedBreach, ...]


@dataclass(frozen=True, slots=True)
class ExpectedDropout:
    """``frame`` has no usable pose from ``start_s`` to ``end_s``."""

    frame: str
    kind: DropoutKind
    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True)
class Expected:
    """The checks of a case; None and the empty tuple mean that a block is not given."""

    registration: ExpectedRegistration | None = None
    breaches: ExpectedBreaches | None = None
    dropouts: tuple[ExpectedDropout, ...] = ()
    frames: int | None = None


def load_expected(path: Path, *, reference: str, robot_base: str) -> Expected:
    """Read ``expected.yaml``; ``reference`` and ``robot_base`` name the registration's frames."""
    return read_expected(Section.load(path, EXPECTED), reference=reference, robot_base=robot_base)


def read_expected(document: Section, *, reference: str, robot_base: str) -> Expected:
    """Read a document with the keys of `EXPECTED`; see `load_expected`."""
    return Expected(
        registration=_registration(document, reference, robot_base),
        breaches=_breaches(document),
        dropouts=_dropouts(document),
        frames=document.integer("frames") if "frames" in document else None,
    )


def write_expected(path: Path, expected: Expected) -> None:
    """Write ``expected`` atomically, so that `load_expected` reads the same values."""
    document: dict[str, Any] = {}
    if expected.registration is not None:
        pose = expected.registration.reference_from_base
        document["registration"] = {
            "reference_from_base": pose.matrix.ravel().tolist(),
            "tolerance_mm": expected.registration.tolerance_mm,
            "tolerance_deg": expected.registration.tolerance_deg,
        }
    if expected.breaches is not None:
        document["breaches"] = {
            "tolerance_ms": expected.breaches.tolerance_ms,
            "depth_tolerance_mm": expected.breaches.depth_tolerance_mm,
            "intervals": [
                {
                    "start_s": breach.start_s,
                    "end_s": breach.end_s,
                    "min_signed_distance_mm": breach.min_signed_distance_mm,
                    "shaft_only": breach.shaft_only,
                }
                for breach in expected.breaches.intervals
            ],
        }
    if expected.dropouts:
        document["dropouts"] = [
            {"frame": d.frame, "kind": d.kind, "start_s": d.start_s, "end_s": d.end_s}
            for d in expected.dropouts
        ]
    if expected.frames is not None:
        document["frames"] = expected.frames
    write_file(path, yaml.safe_dump(document, sort_keys=False).encode())


def _registration(
    document: Section, reference: str, robot_base: str
) -> ExpectedRegistration | None:
    if "registration" not in document:
        return None
    block = document.section("registration")
    numbers = block.numbers("reference_from_base")
    try:
        pose = Transform.from_matrix(numbers, target=reference, source=robot_base)
    except MarginGuardError as error:
        raise InputError(f"{block.place('reference_from_base')}: {error}") from error
    return ExpectedRegistration(
        pose,
        block.number("tolerance_mm"),
        block.number("tolerance_deg"),
    )


def _breaches(document: Section) -> ExpectedBreaches | None:
    if "breaches" not in document:
        return None
    block = document.section("breaches")
    intervals = tuple(
        ExpectedBreach(
            *_span(entry), entry.number("min_signed_distance_mm"), entry.boolean("shaft_only")
        )
        for entry in block.sections("intervals")
    )
    return ExpectedBreaches(
        block.number("tolerance_ms"), block.number("depth_tolerance_mm"), intervals
    )


def _dropouts(document: Section) -> tuple[ExpectedDropout, ...]:
    if "dropouts" not in document:
        return ()
    dropouts = []
    for entry in document.sections("dropouts"):
        kind: DropoutKind = "invalid" if entry.choice("kind") == "invalid" else "missing"
        dropouts.append(ExpectedDropout(entry.text("frame"), kind, *_span(entry)))
    return tuple(dropouts)


def _span(entry: Section) -> tuple[float, float]:
    start_s, end_s = entry.number("start_s"), entry.number("end_s")
    if end_s < start_s:
        raise InputError(
            f"{entry.place('end_s')} is {end_s:g}; expected start_s ({start_s:g}) or later"
        )
    return start_s, end_s
