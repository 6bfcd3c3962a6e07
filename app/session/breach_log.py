"""The breaches of a session so far, with the time, the place and the part of the tool of each.

Page, report and analysis share the rules for beginning and end of a breach and for its place.
"""

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from app.case import ENERGY_DEVICE, Activation
from app.fixture import Proximity
from app.geometry import (
    NS_PER_S,
    FloatArray,
    Freshness,
    FreshnessLimits,
    InputError,
    SurfaceMesh,
    Transform,
    anatomical_direction,
    anatomical_words,
    closest_rotation,
    freshness_of,
)
from app.session.step_result import StepResult

TIP_MM = 2.0
"""A point of the tool this near to its tip is part of the tip."""


def place_letters(outward_mm: FloatArray, ras_from_tumor: FloatArray | None = None) -> str:
    """Letters of the direction ``outward_mm`` (3,), from the tumour's centre to a place on it.

    The letters are those of `anatomical_direction`; empty for length 0 and for unknown numbers.
    ``outward_mm`` is in the tumour's frame, whose axes are taken as right, anterior and superior
    (`docs/case_format.md`, axes) unless ``ras_from_tumor`` (3, 3) turns them.
    """
    if not np.isfinite(outward_mm).all():
        return ""
    turned = outward_mm if ras_from_tumor is None else ras_from_tumor @ outward_mm
    return anatomical_direction(turned)


def is_tip(from_tip_mm: float) -> bool:
    """Whether a point of the tool at this distance from its tip is part of the tip."""
    return from_tip_mm <= TIP_MM


def checked_axes(ras_from_tumor: ArrayLike | None) -> FloatArray | None:
    """The rotation (3, 3); raises `InputError` for a matrix that is no rotation."""
    if ras_from_tumor is None:
        return None
    matrix = np.asarray(ras_from_tumor, dtype=np.float64)
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise InputError(f"ras_from_tumor has shape {matrix.shape}; expected a rotation (3, 3)")
    if np.abs(matrix.T @ matrix - np.eye(3)).max() > 1e-3 or np.linalg.det(matrix) < 0.0:
        raise InputError("ras_from_tumor is no rotation; expected orthonormal rows, no reflection")
    return closest_rotation(matrix)


class InsideRun(Enum):
    """Relation of a frame to the breaches.

    ``UNKNOWN``: no distance, neither begins nor ends a breach. ``OUTSIDE``: ends one. ``BEGINS``:
    the first frame of a breach. ``CONTINUES``: a further frame of the last breach.
    """

    UNKNOWN = "unknown"
    OUTSIDE = "outside"
    BEGINS = "begins"
    CONTINUES = "continues"


class InsideRuns:
    """Divides the frames of a session into breaches, one frame after the other.

    A breach is a run of frames with a negative signed distance, whatever the state is, so that
    hysteresis neither lengthens nor joins breaches. Two inside frames that are more than
    ``stale_after_ns`` apart, or whose stamps run backwards, belong to two breaches.
    """

    def __init__(self, stale_after_ns: int) -> None:
        self._limits = FreshnessLimits(stale_after_ns)
        self._last_inside_ns: int | None = None

    def use(self, stale_after_ns: int) -> None:
        """Use another limit from the next frame on."""
        self._limits = FreshnessLimits(stale_after_ns)

    def observe(self, stamp_ns: int, signed_distance_mm: float | None) -> InsideRun:
        """The next frame; ``signed_distance_mm`` is None where it is not known."""
        if signed_distance_mm is None:
            return InsideRun.UNKNOWN
        if not signed_distance_mm < 0.0:
            self._last_inside_ns = None
            return InsideRun.OUTSIDE
        last_ns, self._last_inside_ns = self._last_inside_ns, stamp_ns
        if last_ns is None or freshness_of(last_ns, stamp_ns, self._limits) is not Freshness.VALID:
            return InsideRun.BEGINS
        return InsideRun.CONTINUES


MAX_LISTED = 200
"""Breaches that are kept in the list: the first one, the deepest one and the last ones."""


@dataclass(frozen=True, slots=True)
class BreachEntry:
    """One breach.

    ``number`` counts from 1. ``first``, ``last`` and ``deepest`` are the indices of the steps at
    its ends and at the largest depth; ``begin_ns``, ``end_ns`` and ``deepest_ns`` their stamps in
    ns, ``begin_s`` its begin in seconds from the first step. ``depth_mm`` is positive. ``place``:
    letters of the direction, in the RAS axes of the tumour's frame, from the centre of the tumour
    to the point of its surface that is nearest to the deepest point of the tool. ``from_tip_mm``:
    distance of that point of the tool from the tip, None if the tip's pose is not known.
    ``is_open``: the tool is still inside at the last step. ``activation``: on if it was at any
    step of it, else unknown if it was, None without a source of its state.
    """

    number: int
    first: int
    last: int
    deepest: int
    begin_ns: int
    end_ns: int
    deepest_ns: int
    begin_s: float
    depth_mm: float
    place: str
    from_tip_mm: float | None
    is_open: bool
    activation: Activation | None = None

    @property
    def duration_s(self) -> float:
        """From its first to its last step in seconds."""
        return (self.end_ns - self.begin_ns) / NS_PER_S

    @property
    def place_text(self) -> str:
        """The place in words; ``centre`` if it has no direction."""
        return anatomical_words(self.place) or "centre"

    @property
    def part_text(self) -> str:
        """The part of the tool in words."""
        if self.from_tip_mm is None:
            return "part of the tool not known"
        if is_tip(self.from_tip_mm):
            return "tip"
        return f"{self.from_tip_mm:.0f} mm from the tip"

    @property
    def tool_text(self) -> str:
        """The part of the tool, and the activation if it has a source."""
        if self.activation is None:
            return self.part_text
        return f"{self.part_text}, {ENERGY_DEVICE.name} {self.activation}"


@dataclass(frozen=True, slots=True)
class BreachList:
    """All breaches up to a step: their ``count``, and the ``entries`` that are kept.

    ``is_inside``: the last one is still open.
    """

    count: int = 0
    entries: tuple[BreachEntry, ...] = ()
    is_inside: bool = False

    @property
    def deepest(self) -> BreachEntry | None:
        """The deepest breach, the first of equal ones; None without a breach."""
        return max(self.entries, key=lambda entry: entry.depth_mm, default=None)

    @property
    def text(self) -> str:
        """One line that stays after a breach: how many, and the deepest; empty without one."""
        deepest = self.deepest
        if deepest is None:
            return ""
        noun = "breach" if self.count == 1 else "breaches"
        return f"{self.count} {noun} so far, deepest {deepest.depth_mm:.1f} mm"


class BreachLog:
    """Lists the breaches of the steps that `observe` is called with, in their order.

    ``tumor`` gives the centre; `use` replaces it, and keeps the breaches of the tumour before.
    """

    def __init__(self, tumor: SurfaceMesh, stale_after_ns: int) -> None:
        self._tumor, self._center_mm = tumor, tumor.centroid_mm
        self._runs = InsideRuns(stale_after_ns)
        self._list = BreachList()
        self._first_ns: int | None = None

    @property
    def breaches(self) -> BreachList:
        """The breaches up to the last step."""
        return self._list

    def use(self, tumor: SurfaceMesh, stale_after_ns: int) -> None:
        """Use another tumour or limit from the next step on."""
        if tumor is not self._tumor:  # of a large surface it takes a millisecond
            self._tumor, self._center_mm = tumor, tumor.centroid_mm
        self._runs.use(stale_after_ns)

    def observe(self, step: StepResult) -> BreachList:
        """Add ``step``, the next one; return all breaches so far."""
        step = step.of_tumor
        if self._first_ns is None:
            self._first_ns = step.frame.stamp.ns
        proximity = step.decision.proximity
        if proximity is None or not np.isfinite(proximity.signed_distance_mm):
            return self._list  # neither begins nor ends a breach
        found = self._runs.observe(step.frame.stamp.ns, float(proximity.signed_distance_mm))
        if found is InsideRun.OUTSIDE:
            self._list = _closed(self._list)
        else:
            self._list = self._extended(step, proximity, found)
        return self._list

    def _extended(self, step: StepResult, proximity: Proximity, found: InsideRun) -> BreachList:
        before = self._list
        here = self._entry(step, proximity, before.count + 1)
        if found is InsideRun.CONTINUES:
            entries = (*before.entries[:-1], _joined(before.entries[-1], here))
            return replace(before, entries=entries)
        entries = (*_closed(before).entries, here)
        return BreachList(before.count + 1, _limited(entries), is_inside=True)

    def _entry(self, step: StepResult, proximity: Proximity, number: int) -> BreachEntry:
        pose, stamp_ns = step.tumor_from_tip, step.frame.stamp.ns
        if step.between_frames is not None:
            pose = step.between_frames.deepest.tumor_from_tip
        return BreachEntry(
            number=number,
            first=step.index,
            last=step.index,
            deepest=step.index,
            begin_ns=stamp_ns,
            end_ns=stamp_ns,
            deepest_ns=stamp_ns,
            begin_s=(stamp_ns - (self._first_ns or 0)) / NS_PER_S,
            depth_mm=-float(proximity.signed_distance_mm),
            place=place_letters(proximity.on_tumor_mm - self._center_mm),
            from_tip_mm=_from_tip_mm(proximity.on_tool_mm, pose),
            is_open=True,
            activation=step.frame.activation,
        )


def _closed(breaches: BreachList) -> BreachList:
    """``breaches`` with the last one ended."""
    if not breaches.is_inside:
        return breaches
    last = replace(breaches.entries[-1], is_open=False)
    return replace(breaches, entries=(*breaches.entries[:-1], last), is_inside=False)


def _joined(breach: BreachEntry, here: BreachEntry) -> BreachEntry:
    """``breach`` with its next step ``here``."""
    states = [each.activation for each in (breach, here) if each.activation is not None]
    activation = max(states, key=lambda state: state.rank, default=None)
    if here.depth_mm <= breach.depth_mm:
        return replace(breach, last=here.last, end_ns=here.end_ns, activation=activation)
    return replace(
        here,
        number=breach.number,
        first=breach.first,
        begin_ns=breach.begin_ns,
        begin_s=breach.begin_s,
        activation=activation,
    )


def _limited(entries: tuple[BreachEntry, ...]) -> tuple[BreachEntry, ...]:
    if len(entries) <= MAX_LISTED:
        return entries
    deepest = max(entries, key=lambda entry: entry.depth_mm)
    dropped = next(entry for entry in entries[1:] if entry is not deepest)
    return tuple(entry for entry in entries if entry is not dropped)


def _from_tip_mm(on_tool_mm: FloatArray, tumor_from_tip: Transform | None) -> float | None:
    if tumor_from_tip is None or not np.isfinite(on_tool_mm).all():
        return None
    return float(np.linalg.norm(on_tool_mm - tumor_from_tip.translation_mm))
