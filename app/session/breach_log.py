"""The breaches of a session so far, with the time, the place and the part of the tool of each.

Page, report and analysis share the rules for beginning and end of a breach and for its place.
"""

from collections.abc import Callable, Mapping
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
from app.session.shown_state import structure_title
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

_TUMOR = ""
"""Key of the tumour among the structures, also where it is the only one."""


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
    step of it, else unknown if it was, None without a source of its state. ``structure``: the name
    of the one that is breached, in whose frame the place is; empty for the tumour alone.
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
    structure: str = ""

    @property
    def duration_s(self) -> float:
        """From its first to its last step in seconds."""
        return (self.end_ns - self.begin_ns) / NS_PER_S

    @property
    def place_text(self) -> str:
        """The structure, and the place in words; ``centre`` if it has no direction."""
        place = anatomical_words(self.place) or "centre"
        return f"{structure_title(self.structure)}, {place}" if self.structure else place

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

    ``is_inside``: one is still open.
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
        where = f" ({structure_title(deepest.structure)})" if deepest.structure else ""
        return f"{self.count} {noun} so far, deepest {deepest.depth_mm:.1f} mm{where}"


class BreachLog:
    """Lists the breaches of the steps that `observe` is called with, in the order they begin.

    ``tumor`` and the further ``structures`` by name give the centres; `use` replaces them, and
    keeps the breaches so far.
    """

    def __init__(
        self, tumor: SurfaceMesh, stale_after_ns: int, structures: Mapping[str, SurfaceMesh]
    ) -> None:
        self._centers: dict[str, tuple[SurfaceMesh, FloatArray]] = {}
        self._runs: dict[str, InsideRuns] = {}
        self._open: dict[str, int] = {}
        self._list = BreachList()
        self._first_ns: int | None = None
        self.use(tumor, stale_after_ns, structures)

    @property
    def breaches(self) -> BreachList:
        """The breaches up to the last step."""
        return self._list

    def use(
        self, tumor: SurfaceMesh, stale_after_ns: int, structures: Mapping[str, SurfaceMesh]
    ) -> None:
        """Use other surfaces or another limit from the next step on."""
        before, self._centers = self._centers, {}
        for name, surface in {_TUMOR: tumor, **structures}.items():
            known = before.get(name)
            if known is None or known[0] is not surface:
                known = surface, surface.centroid_mm  # a millisecond for a large surface
            self._centers[name] = known
        self._stale_after_ns = stale_after_ns
        for runs in self._runs.values():
            runs.use(stale_after_ns)

    def observe(self, step: StepResult) -> BreachList:
        """Add ``step``, the next one; return all breaches so far."""
        stamp_ns = step.frame.stamp.ns
        if self._first_ns is None:
            self._first_ns = stamp_ns
        decisions = {_TUMOR: step.decision}
        if step.structures:
            first, *others = step.structures
            decisions = {_TUMOR: first.decision} | {each.name: each.decision for each in others}
        for name in self._open.keys() - decisions.keys():
            self._close(name)  # the structure is off
        for name, decision in decisions.items():
            proximity = decision.proximity
            if proximity is None or not np.isfinite(proximity.signed_distance_mm):
                continue  # neither begins nor ends a breach
            runs = self._runs.setdefault(name, InsideRuns(self._stale_after_ns))
            found = runs.observe(stamp_ns, float(proximity.signed_distance_mm))
            if found is not InsideRun.CONTINUES:
                self._close(name)
            if found is not InsideRun.OUTSIDE:
                self._extend(name, step, proximity)
        return self._list

    def _close(self, name: str) -> None:
        """End the open breach of a structure, if there is one."""
        number = self._open.pop(name, None)
        if number is not None:
            self._change(number, lambda entry: replace(entry, is_open=False))

    def _extend(self, name: str, step: StepResult, proximity: Proximity) -> None:
        """Begin a breach of a structure with ``step``, or continue its open one."""
        here = self._entry(name, step, proximity)
        number = self._open.setdefault(name, here.number)
        if number == here.number:
            entries = _limited((*self._list.entries, here))
            self._list = BreachList(number, entries, is_inside=True)
        else:
            self._change(number, lambda entry: _joined(entry, here))

    def _change(self, number: int, changed: Callable[[BreachEntry], BreachEntry]) -> None:
        entries = self._list.entries
        entries = tuple(changed(each) if each.number == number else each for each in entries)
        self._list = replace(self._list, entries=entries, is_inside=bool(self._open))

    def _entry(self, name: str, step: StepResult, proximity: Proximity) -> BreachEntry:
        """A breach of this step alone, with the next number."""
        structure = (name or step.structures[0].name) if step.structures else ""
        of_one, stamp_ns = step.of(structure), step.frame.stamp.ns
        pose = of_one.tumor_from_tip
        if of_one.between_frames is not None:
            pose = of_one.between_frames.deepest.tumor_from_tip
        _, center_mm = self._centers.get(name, (None, proximity.on_tumor_mm))
        return BreachEntry(
            number=self._list.count + 1,
            first=step.index,
            last=step.index,
            deepest=step.index,
            begin_ns=stamp_ns,
            end_ns=stamp_ns,
            deepest_ns=stamp_ns,
            begin_s=(stamp_ns - (self._first_ns or 0)) / NS_PER_S,
            depth_mm=-float(proximity.signed_distance_mm),
            place=place_letters(proximity.on_tumor_mm - center_mm),
            from_tip_mm=_from_tip_mm(proximity.on_tool_mm, pose),
            is_open=True,
            activation=step.frame.activation,
            structure=structure,
        )


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
    dropped = next(entry for entry in entries[1:] if not (entry is deepest or entry.is_open))
    return tuple(entry for entry in entries if entry is not dropped)


def _from_tip_mm(on_tool_mm: FloatArray, tumor_from_tip: Transform | None) -> float | None:
    if tumor_from_tip is None or not np.isfinite(on_tool_mm).all():
        return None
    return float(np.linalg.norm(on_tool_mm - tumor_from_tip.translation_mm))
