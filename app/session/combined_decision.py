"""The decision on all structures of a session, from those on each."""

import math
from collections.abc import Sequence

import numpy as np
import scipy  # loads `scipy.optimize` on first use
from numpy.typing import NDArray

from app.fixture import Constraint, FixtureDecision, Proximity, Reason, worst_first
from app.fixture.control.constraint import MAX_PLANES
from app.fixture.control.half_spaces import clearance_mm
from app.fixture.jit import kernel
from app.fixture.proximity.values import FreeMotion, Witnesses
from app.fixture.vectors import rotate_inverse, transform_point, transform_point_inverse
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
        planes, tip = np.zeros((MAX_PLANES + 1, 10)), Transform.identity("tumor", "tip")
        _keep_nearest(planes, np.arange(MAX_PLANES))
        planes.setflags(write=False)
        _placed(planes, tip, tip, planes=True)
        is_narrow(planes, [0])
        self._constraint: Constraint | None = None
        self.half_spaces_of: tuple[int, ...] = ()
        """The structure of each half-space, as its number in ``steps``; empty for one structure."""

    def restart(self) -> None:
        """Forget the planes: a structure, the tool or the registration has changed."""
        self._constraint, self.half_spaces_of = None, ()

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
        decisions = [each.decision for each in steps]
        current = all(each.constraint_is_current for each in decisions)
        hold = any(each.hold for each in decisions)
        if current:
            joined = _joined(steps, governing, radius_mm, far_mm, hold=hold)
            self._constraint, self.half_spaces_of = (None, ()) if joined is None else joined
        elif self._constraint is not None:
            self._constraint = self._constraint.on_hold()
        stamps = [each.stamp for each in decisions]
        known = [stamp for stamp in stamps if stamp is not None]
        reasons = {reason for each in decisions for reason in each.reasons}
        if len(reasons) > 1:
            reasons.discard(Reason.CLEAR)
        planes = self._constraint if current else None
        if planes is not None and is_narrow(planes.rows, self.half_spaces_of):
            reasons.add(Reason.NARROW)
        return FixtureDecision(
            decision.state,
            worst_first(reasons),
            _in_tumor_frame(decision.proximity, steps, governing),
            decision.margin,
            self._constraint,
            hold=hold,
            stamp=min(known) if len(known) == len(stamps) else None,
            seq=steps[0].decision.seq,
            constraint_is_current=current,
        )


def _in_tumor_frame(
    proximity: Proximity | None, steps: Sequence[StructureStep], number: int
) -> Proximity | None:
    tumor_from_tip = steps[0].structure_from_tip
    structure_from_tip = steps[number].structure_from_tip
    if number == 0 or proximity is None:
        return proximity
    if tumor_from_tip is None or structure_from_tip is None:
        return None
    rows = _placed(proximity.witnesses.rows, structure_from_tip, tumor_from_tip, planes=False)
    witnesses, lower_mm = Witnesses.of_rows(rows), proximity.lower_bound_mm
    return Proximity(lower_mm, witnesses, proximity.stamp, proximity.contact, proximity.free)


def _joined(
    steps: Sequence[StructureStep],
    governing: int,
    radius_mm: float,
    far_mm: float,
    *,
    hold: bool,
) -> tuple[Constraint, tuple[int, ...]] | None:
    """The planes of the structures in the tumour's frame, `MAX_PLANES` at most, and whose they are.

    The governing plane is first. Of more planes the nearest are kept, and far structures have none;
    the free motion then ends before one of those that are left out is reached.
    """
    tumor_from_tip = steps[0].structure_from_tip
    planes: list[FloatArray] = []
    owners: list[int] = []
    free = [_free_up_to(far_mm, radius_mm)]
    near = [number for number, each in enumerate(steps) if each.at_least_mm is None]
    for number in (governing, *(each for each in near if each != governing)):
        structure_from_tip = steps[number].structure_from_tip
        constraint = steps[number].decision.constraint
        if constraint is None or tumor_from_tip is None or structure_from_tip is None:
            return None
        rows = constraint.rows
        if number > 0:
            rows = _placed(rows, structure_from_tip, tumor_from_tip, planes=True)
        planes.append(rows)
        owners += [number] * len(rows)
        free.append(constraint.free)
    rows = np.concatenate(planes)
    if len(rows) > MAX_PLANES:
        kept = np.arange(MAX_PLANES)
        nearest_left_out_mm = max(_keep_nearest(rows, kept), 0.0)
        free.append(_free_up_to(nearest_left_out_mm, radius_mm))
        rows, owners = rows.take(kept, axis=0), [owners[number] for number in kept.tolist()]
    least = FreeMotion(
        min([each.distance_mm for each in free]), min([each.turn_rad for each in free])
    )
    return Constraint.unchecked(steps[0].name, rows, hold=hold, free=least), tuple(owners)


def _placed(
    rows: FloatArray, structure_from_tip: Transform, tumor_from_tip: Transform, *, planes: bool
) -> FloatArray:
    """``rows`` (k, 10) of witnesses, or of ``planes``, of a structure in the tumour's frame."""
    placed = np.empty(rows.shape)
    _place(
        rows,
        structure_from_tip.rotation,
        structure_from_tip.translation_mm,
        tumor_from_tip.rotation,
        tumor_from_tip.translation_mm,
        planes,
        placed,
    )
    return placed


@kernel
def _place(
    rows: FloatArray,
    rotation: FloatArray,
    tip_mm: FloatArray,
    tumor_rotation: FloatArray,
    tumor_tip_mm: FloatArray,
    planes: bool,
    placed: FloatArray,
) -> None:
    """Write ``rows`` (k, 10) of a structure in the tumour's frame to ``placed`` (k, 10).

    ``rotation`` (3, 3) and ``tip_mm`` (3,) are the pose of the tip in the frame of the structure. A
    row of ``planes``: offset, normal, point, velocity; another one: distance, two points, normal.
    """
    at_tip = transform_point_inverse(rotation, tip_mm, (0.0, 0.0, 0.0))
    origin = transform_point(tumor_rotation, tumor_tip_mm, at_tip)
    for k in range(len(rows)):
        placed[k, 0] = rows[k, 0]
        for i in (1, 4, 7):
            at_tip = rotate_inverse(rotation, (rows[k, i], rows[k, i + 1], rows[k, i + 2]))
            is_point = i == 4 or (i == 1 and not planes)
            for j in range(3):
                turned = tumor_rotation[j]
                value = turned[0] * at_tip[0] + turned[1] * at_tip[1] + turned[2] * at_tip[2]
                placed[k, i + j] = value + origin[j] if is_point else value
                if planes and i == 1:
                    placed[k, 0] += value * origin[j]


@kernel
def _keep_nearest(planes: FloatArray, kept: NDArray[np.int64]) -> float:
    """Write to ``kept`` (m,), which is 0 to m - 1, the numbers of the planes to keep, in order.

    These are the first of ``planes`` (k, 10), k > m, and the m - 1 others of the smallest
    clearances. Returns the smallest clearance in mm of those that are left out.
    """
    size, left_out_mm = len(kept), math.inf
    for new in range(size, len(planes)):
        farthest, largest_mm = size, clearance_mm(planes, new)
        for i in range(size - 1, 0, -1):  # of equal clearances the last is left out
            found_mm = clearance_mm(planes, kept[i])
            if found_mm > largest_mm:
                farthest, largest_mm = i, found_mm
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
        if clearance_mm(planes, k) < 0.0:
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
