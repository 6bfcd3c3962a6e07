"""The decision on all structures of a session, from those on each."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import scipy  # loads `scipy.optimize` on first use
from numpy.typing import NDArray

from app.fixture import Constraint, FixtureDecision, Proximity, Reason, worst_first
from app.fixture.control.constraint import MAX_PLANES
from app.fixture.jit import inlined, kernel
from app.fixture.proximity.values import FreeMotion, Witnesses
from app.geometry import FloatArray, Transform
from app.session.structure import StructureStep, governing_number


class CombinedDecision:
    """Joins the decisions on all structures to that of the session, in the tumour's frame.

    The state is the worst. The reasons are those of all structures. Distance and margin are those
    of the *governing* structure: of the worst state, and among these of the smallest clearance. The
    constraint holds the planes of all structures that are not far, the governing one first, or none
    that is current unless all are: to leave one structure may mean to approach another.
    """

    def __init__(self) -> None:
        # Run the kernels once, so that the first step does not wait for the compiler.
        planes = np.zeros((MAX_PLANES + 1, 10))
        _rotate(planes, Transform.identity("tumor", "tumor").rotation)
        _keep_nearest(planes, np.arange(MAX_PLANES))
        planes.setflags(write=False)
        is_narrow(planes, [0])
        self._constraint: Constraint | None = None
        self.half_spaces_of: tuple[int, ...] = ()
        """The structure of each half-space, as its number in ``steps``; empty for one structure."""

    def restart(self) -> None:
        """Forget the planes: a structure, the tool or the registration has changed."""
        self._constraint = None

    def of(
        self, steps: Sequence[StructureStep], radius_mm: float, far_mm: float = math.inf
    ) -> FixtureDecision:
        """The decision on ``steps``, the tumour's first; ``radius_mm`` is that of the tool.

        With one structure it is the decision on that. The clearance of each far structure is at
        least ``far_mm``.
        """
        if len(steps) == 1:
            return steps[0].decision
        governing = governing_number(steps)
        decision = steps[governing].decision
        near = [number for number, each in enumerate(steps) if each.at_least_mm is None]
        places = {number: _tumor_from(steps, number) for number in near if number > 0}
        current = all(each.decision.constraint_is_current for each in steps)
        hold = any(each.decision.hold for each in steps)
        if current:
            joined = _joined(steps, governing, places, radius_mm, far_mm, hold=hold)
            self._constraint, self.half_spaces_of = (None, ()) if joined is None else joined
        elif self._constraint is not None:
            self._constraint = self._constraint.on_hold()
        stamps = [each.decision.stamp for each in steps]
        known = [stamp for stamp in stamps if stamp is not None]
        reasons = {reason for each in steps for reason in each.decision.reasons}
        if len(reasons) > 1:
            reasons.discard(Reason.CLEAR)
        planes = self._constraint if current else None
        if planes is not None and is_narrow(planes.rows, self.half_spaces_of):
            reasons.add(Reason.NARROW)
        return FixtureDecision(
            decision.state,
            worst_first(reasons),
            _in_tumor_frame(decision.proximity, governing, places),
            decision.margin,
            self._constraint,
            hold=hold,
            stamp=min(known) if len(known) == len(stamps) else None,
            seq=steps[0].decision.seq,
            constraint_is_current=current,
        )


def _tumor_from(steps: Sequence[StructureStep], number: int) -> Transform | None:
    """The structure in the tumour's frame, both as the tool sees them; None if not known."""
    tumor_from_tip = steps[0].structure_from_tip
    structure_from_tip = steps[number].structure_from_tip
    if tumor_from_tip is None or structure_from_tip is None:
        return None
    return tumor_from_tip @ structure_from_tip.inverse()


_Places: TypeAlias = Mapping[int, Transform | None]
"""`_tumor_from` of the near structures of one step but the tumour."""


def _in_tumor_frame(proximity: Proximity | None, number: int, places: _Places) -> Proximity | None:
    if number == 0 or proximity is None:
        return proximity
    placed = places[number]
    if placed is None:
        return None
    rows = proximity.witnesses.rows.copy()
    _rotate(rows, placed.rotation)
    rows[:, 1:4] += placed.translation_mm
    rows[:, 4:7] += placed.translation_mm
    return replace(proximity, witnesses=Witnesses.of_rows(rows))


def _joined(
    steps: Sequence[StructureStep],
    governing: int,
    places: _Places,
    radius_mm: float,
    far_mm: float,
    *,
    hold: bool,
) -> tuple[Constraint, tuple[int, ...]] | None:
    """The planes of the structures in the tumour's frame, `MAX_PLANES` at most, and whose they are.

    The governing plane is first. Of more planes the nearest are kept, and far structures have none;
    the free motion then ends before one of those that are left out is reached.
    """
    planes: list[FloatArray] = []
    owners: list[int] = []
    free = [_free_up_to(far_mm, radius_mm)]
    for number in dict.fromkeys((governing, 0, *places)):
        constraint = steps[number].decision.constraint
        if constraint is None:
            return None
        rows = constraint.rows
        if number > 0:
            placed = places[number]
            if placed is None:
                return None
            rows = rows.copy()
            _rotate(rows, placed.rotation)
            rows[:, 4:7] += placed.translation_mm
            rows[:, 0] += rows[:, 1:4] @ placed.translation_mm
        planes.append(rows)
        owners += [number] * len(rows)
        free.append(constraint.free)
    rows = np.concatenate(planes)
    if len(rows) > MAX_PLANES:
        kept = np.arange(MAX_PLANES)
        nearest_left_out_mm = max(_keep_nearest(rows, kept), 0.0)
        free.append(_free_up_to(nearest_left_out_mm, radius_mm))
        rows, owners = rows[kept], [owners[number] for number in kept.tolist()]
    least = FreeMotion(*map(min, zip(*free, strict=True)))
    return Constraint.unchecked(steps[0].name, rows, hold=hold, free=least), tuple(owners)


@kernel
def _rotate(rows: FloatArray, rotation: FloatArray) -> None:
    """Rotate the three vectors in the columns 1 to 9 of ``rows`` (k, 10), in place."""
    for k in range(len(rows)):
        for i in (1, 4, 7):
            x, y, z = rows[k, i], rows[k, i + 1], rows[k, i + 2]
            for j in range(3):
                rows[k, i + j] = rotation[j, 0] * x + rotation[j, 1] * y + rotation[j, 2] * z


@inlined
def _clearance_mm(plane: FloatArray) -> float:
    return float(plane[1] * plane[4] + plane[2] * plane[5] + plane[3] * plane[6] - plane[0])


@kernel
def _keep_nearest(planes: FloatArray, kept: NDArray[np.int64]) -> float:
    """Write to ``kept`` (m,), which is 0 to m - 1, the numbers of the planes to keep, in order.

    These are the first of ``planes`` (k, 10), k > m, and the m - 1 others of the smallest
    clearances. Returns the smallest clearance in mm of those that are left out.
    """
    size, left_out_mm = len(kept), math.inf
    for new in range(size, len(planes)):
        farthest, largest_mm = size, _clearance_mm(planes[new])
        for i in range(size - 1, 0, -1):  # of equal clearances the last is left out
            clearance_mm = _clearance_mm(planes[kept[i]])
            if clearance_mm > largest_mm:
                farthest, largest_mm = i, clearance_mm
        left_out_mm = min(left_out_mm, largest_mm)
        if farthest < size:
            for i in range(farthest, size - 1):
                kept[i] = kept[i + 1]
            kept[size - 1] = new
    return left_out_mm


NARROW_MM = 10.0
"""Way in mm within which a tool may leave the stop margins of all structures at once."""


def is_narrow(rows: FloatArray, owners: Sequence[int]) -> bool:
    """True if the tool is in the stop margins of two structures, and cannot leave all close by.

    ``rows`` (k, 10) are those of a constraint, ``owners`` the structures of its planes. The
    shortest translation to where all planes have a clearance of at least 0 is a least distance
    problem (Lawson and Hanson, "Solving Least Squares Problems", 1974, chapter 23); beyond
    `NARROW_MM` the planes say nothing about the structures.
    """
    if not _are_two_breached(rows, np.array(owners)):
        return False
    missing_mm = rows[:, 0] - np.einsum("ij,ij->i", rows[:, 1:4], rows[:, 4:7])
    problem = np.vstack([rows[:, 1:4].T, missing_mm / NARROW_MM])
    target = np.array([0.0, 0.0, 0.0, 1.0])
    share = 1.0 - problem[3] @ scipy.optimize.nnls(problem, target)[0]
    # The way is sqrt(1 / share - 1) times `NARROW_MM`; without a solution the share is 0.
    return bool(share < 0.5)


@kernel
def _are_two_breached(planes: FloatArray, owners: NDArray[np.int64]) -> bool:
    """True if ``planes`` (k, 10) of two of their ``owners`` (k,) have clearances below 0."""
    owner = -1
    for k in range(len(planes)):
        if _clearance_mm(planes[k]) < 0.0:
            if owner not in (-1, owners[k]):
                return True
            owner = owners[k]
    return False


def _free_up_to(clearance_mm: float, radius_mm: float) -> FreeMotion:
    """The motion up to a plane with this clearance.

    A point of the tool at the lever ``radius_mm`` moves by the way of the tip and the angle times
    the lever at most.
    """
    return FreeMotion(clearance_mm, clearance_mm / radius_mm if radius_mm > 0.0 else math.inf)
