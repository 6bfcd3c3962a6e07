"""The decision on all structures of a session, from those on each."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import TypeAlias

import numpy as np
import scipy  # loads `scipy.optimize` on first use

from app.fixture import Constraint, FixtureDecision, Proximity, Reason, worst_first
from app.fixture.control.constraint import MAX_PLANES
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
        place = cache(partial(_tumor_from, steps))
        current = all(each.decision.constraint_is_current for each in steps)
        hold = any(each.decision.hold for each in steps)
        if current:
            joined = _joined(steps, governing, place, radius_mm, far_mm, hold=hold)
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
        return replace(
            decision,
            reasons=worst_first(reasons),
            proximity=_in_tumor_frame(decision.proximity, governing, place),
            constraint=self._constraint,
            hold=hold,
            seq=steps[0].decision.seq,
            stamp=min(known) if len(known) == len(stamps) else None,
            constraint_is_current=current,
        )


def _tumor_from(steps: Sequence[StructureStep], number: int) -> Transform | None:
    """The structure in the tumour's frame, both as the tool sees them; None if not known."""
    tumor_from_tip = steps[0].structure_from_tip
    structure_from_tip = steps[number].structure_from_tip
    if tumor_from_tip is None or structure_from_tip is None:
        return None
    return tumor_from_tip @ structure_from_tip.inverse()


_Place: TypeAlias = Callable[[int], Transform | None]
"""`_tumor_from` of the structures of one step."""


def _in_tumor_frame(proximity: Proximity | None, number: int, place: _Place) -> Proximity | None:
    if number == 0 or proximity is None:
        return proximity
    placed = place(number)
    if placed is None:
        return None
    rows = proximity.witnesses.rows.copy()
    rows[:, 1:4], rows[:, 4:7] = placed.apply(rows[:, 1:4]), placed.apply(rows[:, 4:7])
    rows[:, 7:] = placed.rotate(rows[:, 7:])
    return replace(proximity, witnesses=Witnesses.of_rows(rows))


def _joined(
    steps: Sequence[StructureStep],
    governing: int,
    place: _Place,
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
    free = _free_up_to(far_mm, radius_mm)
    near = [number for number, each in enumerate(steps) if each.at_least_mm is None]
    for number in (governing, *(each for each in near if each != governing)):
        constraint = steps[number].decision.constraint
        placed = None if constraint is None else _placed_rows(constraint.rows, number, place)
        if constraint is None or placed is None:
            return None
        planes.append(placed)
        owners += [number] * len(constraint)
        free = _smaller(free, constraint.free)
    rows = np.concatenate(planes)
    if len(rows) > MAX_PLANES:
        clearances = np.einsum("ij,ij->i", rows[:, 1:4], rows[:, 4:7]) - rows[:, 0]
        order = 1 + np.argsort(clearances[1:], kind="stable")
        nearest_left_out_mm = max(float(clearances[order[MAX_PLANES - 1]]), 0.0)
        free = _smaller(free, _free_up_to(nearest_left_out_mm, radius_mm))
        kept = [0, *np.sort(order[: MAX_PLANES - 1]).tolist()]
        rows, owners = rows[kept], [owners[number] for number in kept]
    return Constraint.unchecked(steps[0].name, rows, hold=hold, free=free), tuple(owners)


NARROW_MM = 10.0
"""Way in mm within which a tool may leave the stop margins of all structures at once."""


def is_narrow(rows: FloatArray, owners: Sequence[int]) -> bool:
    """True if the tool is in the stop margins of two structures, and cannot leave all close by.

    ``rows`` (k, 10) are those of a constraint, ``owners`` the structures of its planes. The
    shortest translation to where all planes have a clearance of at least 0 is a least distance
    problem (Lawson and Hanson, "Solving Least Squares Problems", 1974, chapter 23); beyond
    `NARROW_MM` the planes say nothing about the structures.
    """
    missing_mm = rows[:, 0] - np.einsum("ij,ij->i", rows[:, 1:4], rows[:, 4:7])
    if len({owner for owner, mm in zip(owners, missing_mm, strict=True) if mm > 0.0}) < 2:
        return False
    problem = np.vstack([rows[:, 1:4].T, missing_mm / NARROW_MM])
    target = np.array([0.0, 0.0, 0.0, 1.0])
    share = 1.0 - problem[3] @ scipy.optimize.nnls(problem, target)[0]
    # The way is sqrt(1 / share - 1) times `NARROW_MM`; without a solution the share is 0.
    return bool(share < 0.5)


def _free_up_to(clearance_mm: float, radius_mm: float) -> FreeMotion:
    """The motion up to a plane with this clearance.

    A point of the tool at the lever ``radius_mm`` moves by the way of the tip and the angle times
    the lever at most.
    """
    return FreeMotion(clearance_mm, clearance_mm / radius_mm if radius_mm > 0.0 else math.inf)


def _smaller(one: FreeMotion, other: FreeMotion) -> FreeMotion:
    return FreeMotion(min(one.distance_mm, other.distance_mm), min(one.turn_rad, other.turn_rad))


def _placed_rows(rows: FloatArray, number: int, place: _Place) -> FloatArray | None:
    """``rows`` (k, 10) of a constraint in the tumour's frame: offset, normal, point, velocity."""
    if number == 0:
        return rows
    placed = place(number)
    if placed is None:
        return None
    moved = np.empty_like(rows)
    moved[:, 1:] = placed.rotate(rows[:, 1:].reshape(-1, 3)).reshape(-1, 9)
    moved[:, 4:7] += placed.translation_mm
    moved[:, 0] = rows[:, 0] + moved[:, 1:4] @ placed.translation_mm
    return moved
