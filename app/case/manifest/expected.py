"""Expected results of a replay, with tolerances: ``expected.yaml``.

Every block is optional and checked only where it is given. Times are in seconds from the first
frame of the recording.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import yaml

from app.files.atomic_io import write_file
from app.files.document import Section
from app.geometry import InputError, Transform

DropoutKind = Literal["invalid", "missing"]


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
    document = Section.load(path, ("registration", "breaches", "dropouts", "frames"))
    return Expected(
        registration=_registration(document, reference, robot_base),
        breaches=_breaches(document),
        dropouts=_dropouts(document),
        frames=document.integer("frames", minimum=0) if "frames" in document else None,
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
    block = document.section(
        "registration", ("reference_from_base", "tolerance_mm", "tolerance_deg")
    )
    return ExpectedRegistration(
        Transform.from_matrix(
            block.numbers("reference_from_base", 16), target=reference, source=robot_base
        ),
        block.number("tolerance_mm", minimum=0.0),
        block.number("tolerance_deg", minimum=0.0),
    )


def _breaches(document: Section) -> ExpectedBreaches | None:
    if "breaches" not in document:
        return None
    block = document.section("breaches", ("tolerance_ms", "depth_tolerance_mm", "intervals"))
    keys = ("start_s", "end_s", "min_signed_distance_mm", "shaft_only")
    intervals = tuple(
        ExpectedBreach(
            *_span(entry),
            entry.number("min_signed_distance_mm"),
            entry.boolean("shaft_only") if "shaft_only" in entry else False,
        )
        for entry in block.sections("intervals", keys)
    )
    return ExpectedBreaches(
        block.number("tolerance_ms", minimum=0.0),
        block.number("depth_tolerance_mm", minimum=0.0),
        intervals,
    )


def _dropouts(document: Section) -> tuple[ExpectedDropout, ...]:
    if "dropouts" not in document:
        return ()
    dropouts = []
    for entry in document.sections("dropouts", ("frame", "kind", "start_s", "end_s")):
        kind: DropoutKind = (
            "invalid" if entry.choice("kind", ("invalid", "missing")) == "invalid" else "missing"
        )
        dropouts.append(ExpectedDropout(entry.text("frame"), kind, *_span(entry)))
    return tuple(dropouts)


def _span(entry: Section) -> tuple[float, float]:
    start_s, end_s = entry.number("start_s"), entry.number("end_s")
    if end_s < start_s:
        raise InputError(
            f"{entry.place('end_s')} is {end_s:g}; expected start_s ({start_s:g}) or later"
        )
    return start_s, end_s
