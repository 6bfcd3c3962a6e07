"""Rows of a report, one per step: plain numbers, to keep a long replay small in memory.

``margin.csv`` holds them; their reasons are counted.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from types import MappingProxyType
from typing import TYPE_CHECKING, Self

import numpy as np

from app.case import ENERGY_DEVICE, Activation
from app.fixture import MarginState, Reason
from app.geometry import NS_PER_S, FloatArray, MarginGuardError

if TYPE_CHECKING:
    from app.session import StepResult

COLUMNS = (
    "t_s",
    "stamp_ns",
    "state",
    "signed_distance_mm",
    "lower_bound_mm",
    "reasons",
    "tip_x_mm",
    "tip_y_mm",
    "tip_z_mm",
)
ACTIVATION = ENERGY_DEVICE.name
"""Last column, of a case with a source of the activation."""


NO_STRUCTURES: Mapping[str, Sequence["ReportRow"]] = MappingProxyType({})


class ReportError(MarginGuardError):
    """The report cannot be made: its folder is not writable, or a row has an invalid value."""


@dataclass(frozen=True, slots=True)
class ReportRow:
    """One frame of the replay.

    ``signed_distance_mm`` and ``lower_bound_mm`` are None where the step did not evaluate them;
    ``tip_mm`` is the tool's tip in tumour coordinates, None where it is not known;
    ``stop_total_mm`` and ``warn_total_mm`` are the margins that the step applied, None where it
    applied none. ``between_frames`` is true if the tool passed through the tumour on the path from
    the last frame and is outside in both; the distance is then that of the deepest point of the
    path. ``activation`` is by the source of the case, None without one. Raises `ReportError`
    for a number that is not finite: an unknown value is None.
    """

    stamp_ns: int
    state: MarginState
    reasons: tuple[str, ...] = ()
    signed_distance_mm: float | None = None
    lower_bound_mm: float | None = None
    tip_mm: tuple[float, float, float] | None = None
    stop_total_mm: float | None = None
    warn_total_mm: float | None = None
    between_frames: bool = False
    activation: Activation | None = None

    def __post_init__(self) -> None:
        numbers = (
            self.signed_distance_mm,
            self.lower_bound_mm,
            self.stop_total_mm,
            self.warn_total_mm,
            *(self.tip_mm or ()),
        )
        for number in numbers:
            if number is not None and not math.isfinite(number):
                raise ReportError(
                    f"row at {self.stamp_ns} ns: {number}; expected finite numbers or None"
                )

    @classmethod
    def from_step(cls, step: "StepResult") -> Self:
        """Build the row of one step of the session."""
        decision = step.decision
        proximity, margin = decision.proximity, decision.margin
        tip = step.tumor_from_tip
        return cls(
            stamp_ns=step.frame.stamp.ns,
            state=decision.state,
            reasons=_texts(decision.reasons),
            signed_distance_mm=_finite(proximity.signed_distance_mm) if proximity else None,
            lower_bound_mm=_finite(proximity.lower_bound_mm) if proximity else None,
            tip_mm=None if tip is None else _point(tip.translation_mm.tolist()),
            stop_total_mm=_finite(margin.total_mm) if margin else None,
            warn_total_mm=_finite(margin.warn_total_mm) if margin else None,
            between_frames=step.between_frames is not None,
            activation=step.frame.activation,
        )

    @property
    def inside(self) -> bool:
        """True if this frame has a distance and the tool is in the tumour."""
        return self.signed_distance_mm is not None and self.signed_distance_mm < 0.0


def seconds_since(first_ns: int, stamp_ns: int) -> float:
    """Seconds between two stamps of one clock."""
    return (stamp_ns - first_ns) / NS_PER_S


def played_seconds(rows: Sequence[ReportRow]) -> FloatArray:
    """Seconds since the first row (n,), non-decreasing: a jump back of the clock counts as 0 s."""
    steps_ns = np.diff(np.array([row.stamp_ns for row in rows], dtype=np.int64))
    return np.concatenate([[0], np.cumsum(np.maximum(steps_ns, 0))]) / NS_PER_S


def state_bands(
    rows: Sequence[ReportRow], seconds: FloatArray
) -> Iterator[tuple[MarginState, float, float]]:
    """Yield runs of one state with start and end in seconds; a state holds until the next row."""
    for state, run in groupby(range(len(rows)), key=lambda index: rows[index].state):
        indices = list(run)
        after = min(indices[-1] + 1, len(rows) - 1)
        yield state, float(seconds[indices[0]]), float(seconds[after])


@lru_cache(maxsize=256)  # a replay has few sets of reasons, which its rows share
def _texts(reasons: tuple[Reason, ...]) -> tuple[str, ...]:
    return tuple(str(reason) for reason in reasons)


def _finite(number: float) -> float | None:
    # A proximity that is not finite makes the state UNKNOWN; its row has no distance.
    return float(number) if math.isfinite(number) else None


def _point(values: list[float]) -> tuple[float, float, float]:
    x, y, z = values
    return (x, y, z)


@dataclass(frozen=True, slots=True)
class ReasonCount:
    """``reason`` was among the reasons of ``frames`` frames, first at ``first_s`` seconds."""

    reason: str
    frames: int
    first_s: float


def count_reasons(rows: Sequence[ReportRow]) -> tuple[ReasonCount, ...]:
    """Count every reason that occurs, the most frequent first."""
    counts: dict[str, int] = {}
    first_s: dict[str, float] = {}
    for row in rows:
        for reason in row.reasons:
            counts[reason] = counts.get(reason, 0) + 1
            first_s.setdefault(reason, seconds_since(rows[0].stamp_ns, row.stamp_ns))
    ordered = sorted(counts, key=lambda reason: (-counts[reason], reason))
    return tuple(ReasonCount(reason, counts[reason], first_s[reason]) for reason in ordered)


def margin_csv(
    rows: Sequence[ReportRow], structures: Mapping[str, Sequence[ReportRow]] = NO_STRUCTURES
) -> str:
    """Return the text of ``margin.csv``: a header and one line per row, each ended by a line feed.

    Times and lengths have 6 decimals, an unknown value is an empty cell, reasons are joined by
    ``;``. No cell needs quotes: the names of states and reasons have no commas. The bytes do not
    depend on the machine or the rate of the replay. ``structures`` are the rows of further
    structures by name, which add their state and distances as columns.
    """
    columns = [*COLUMNS]
    cells = [_cells(row, rows[0].stamp_ns) for row in rows]
    for name, others in structures.items():
        columns += [f"{name}_{column}" for column in COLUMNS[2:5]]
        cells = [
            (*before, *_cells(row, rows[0].stamp_ns)[2:5])
            for before, row in zip(cells, others, strict=True)
        ]
    if any(row.activation is not None for row in rows):
        columns.append(ACTIVATION)
        cells = [
            (*before, str(row.activation or "")) for before, row in zip(cells, rows, strict=True)
        ]
    return "\n".join(",".join(line) for line in (columns, *cells)) + "\n"


def _cells(row: ReportRow, first_ns: int) -> tuple[str, ...]:
    x, y, z = row.tip_mm or (None, None, None)
    return (
        _number(seconds_since(first_ns, row.stamp_ns)),
        str(row.stamp_ns),
        row.state.name,
        _number(row.signed_distance_mm),
        _number(row.lower_bound_mm),
        ";".join(row.reasons),
        _number(x),
        _number(y),
        _number(z),
    )


def _number(value: float | None) -> str:
    if value is None:
        return ""
    text = f"{value:.6f}"
    # The sign of a rounded zero depends on the last bit, which differs between machines.
    return text[1:] if text == "-0.000000" else text
