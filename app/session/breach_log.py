"""The breaches of a session so far, with the time, the place and the part of the tool of each.

Breaches are counted by `InsideRuns`, and places named by `breach_place`, as in the report.
"""

from dataclasses import dataclass, replace

import numpy as np

from app.case import CauteryState
from app.fixture import Proximity
from app.geometry import NS_PER_S, FloatArray, SurfaceMesh, Transform, anatomical_words
from app.session.breach_place import is_tip, place_letters
from app.session.inside_runs import InsideRun, InsideRuns
from app.session.step_result import StepResult

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
    ``is_open``: the tool is still inside at the last step. ``cautery``: on if it was at any step of
    it, else unknown if it was, None without a source of its state.
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
    cautery: CauteryState | None = None

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
        """The part of the tool, and the state of the cautery if it has a source."""
        if self.cautery is None:
            return self.part_text
        return f"{self.part_text}, cautery {self.cautery}"


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
            cautery=step.frame.cautery,
        )


def _closed(breaches: BreachList) -> BreachList:
    """``breaches`` with the last one ended."""
    if not breaches.is_inside:
        return breaches
    last = replace(breaches.entries[-1], is_open=False)
    return replace(breaches, entries=(*breaches.entries[:-1], last), is_inside=False)


def _joined(breach: BreachEntry, here: BreachEntry) -> BreachEntry:
    """``breach`` with its next step ``here``."""
    states = [each.cautery for each in (breach, here) if each.cautery is not None]
    cautery = max(states, key=lambda state: state.rank, default=None)
    if here.depth_mm <= breach.depth_mm:
        return replace(breach, last=here.last, end_ns=here.end_ns, cautery=cautery)
    return replace(
        here,
        number=breach.number,
        first=breach.first,
        begin_ns=breach.begin_ns,
        begin_s=breach.begin_s,
        cautery=cautery,
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
