"""A tree of links with closed loops: the positions of the dependent joints follow from the others.

Each loop is cut at one joint, a `LoopClosure`. Newton's method on the residual of all closures
gives the dependent joints, in steps from the assembled pose, at which all joints are near 0, so
that the result stays on the branch in which the mechanism is assembled (Featherstone, Rigid Body
Dynamics Algorithms, 2008, chapter 8). The result depends on the positions alone.
"""

import math
from collections.abc import Iterator, Mapping, Sequence, Set
from functools import lru_cache

import numpy as np

from app.geometry import FloatArray
from app.robot.elements import Joint, JointError, LoopClosure, UrdfError
from app.robot.kinematic_tree import KinematicTree

CLOSED = 1e-9
"""Largest gap of a loop that closes, in mm and in rad."""

ROUNDED_MM, ROUNDED_RAD = 2.0, math.radians(1.0)
"""Largest gaps of a loop whose numbers are rounded, so that it closes at no position."""

_MAX_ITERATIONS = 40
_STEP_RAD, _STEP_M = 0.2, 0.05
_MAX_STEPS = 400
_CONTRADICTION_RAD, _CONTRADICTION_M = math.radians(3.0), 0.005
_DEPENDENT_SHARE, _ROUNDED_SHARE = 1e-6, 0.05
_ROUNDED_LEVER = 2.0
"""Least part of a column of rounded numbers, in mm per rad or m, that is more than rounding: an
axis that misses a point by 0.1 mm does not move it."""


class ClosedTree(KinematicTree):
    """A `KinematicTree` over ``joints``, with loops closed by ``closures``.

    ``dependent`` has the names of the joints that follow from the others; those nearest to the root
    are the independent ones. ``gaps`` has, for each closure, the gap (mm, rad) at the assembled
    pose. Raises `UrdfError` for a loop that does not close there within `ROUNDED_MM` and
    `ROUNDED_RAD`, and as `KinematicTree`.
    """

    def __init__(
        self,
        link_names: Sequence[str],
        joints: Sequence[Joint],
        closures: Sequence[LoopClosure],
    ) -> None:
        super().__init__(link_names, joints)
        self._closures = tuple(closures)
        for closure in closures:
            for link in (closure.parent, closure.child):
                if link not in self.link_rows:
                    raise UrdfError(
                        f"link {link!r} of joint {closure.name!r} is not a link; expected one"
                    )
        self._columns = [joint for joint in self.joints if joint.moves]
        self._rows_of_columns = [self.link_rows[joint.child] for joint in self._columns]
        self._column_axes = np.array([joint.axis for joint in self._columns]).reshape(-1, 3)
        self._column_pivots_mm = np.array([joint.pivot_mm for joint in self._columns]).reshape(
            -1, 3
        )
        self._column_slides = np.array([joint.slides for joint in self._columns], dtype=np.bool_)
        self._signs = np.array([list(self._signs_of(closure)) for closure in closures])
        self._signs = self._signs.reshape(len(closures), len(self._columns))
        self._limit = (ROUNDED_MM, ROUNDED_RAD)
        zeros = {joint.name: 0.0 for joint in self._columns}
        at_zero = self.link_matrices(zeros)
        is_exact = all(max(self._gap(each, at_zero)) <= CLOSED for each in closures)
        is_dependent = self._choose_dependent(
            at_zero, *((_DEPENDENT_SHARE, 0.0) if is_exact else (_ROUNDED_SHARE, _ROUNDED_LEVER))
        )
        self._dependent = np.flatnonzero(is_dependent)
        self._independent = np.flatnonzero(~is_dependent)
        self.dependent = frozenset(self._columns[k].name for k in self._dependent)
        self._in_group = self._groups()
        self._zero = np.zeros(len(self._columns))
        try:
            self._zero = self._closed(self._zero)
        except JointError as problem:
            raise UrdfError(str(problem)) from problem
        self._require_assembled()
        matrices = self.link_matrices(self._named(self._zero))
        self.gaps = tuple(self._gap(closure, matrices) for closure in closures)
        if all(max(gap) <= CLOSED for gap in self.gaps):
            self._limit = (CLOSED, CLOSED)
        self._solved = lru_cache(maxsize=64)(self._solve)

    def complete_positions(self, given: Mapping[str, float]) -> dict[str, float]:
        """Return the position of every moving joint; those of ``dependent`` close the loops.

        Raises `JointError` also where a loop does not close, and for a given position of a
        dependent joint that contradicts the others by more than 3 degrees or 5 mm.
        """
        positions = super().complete_positions(given)
        values = self._solved(
            tuple(positions[self._columns[k].name] for k in self._independent.tolist())
        )
        for k in self._dependent.tolist():
            joint = self._columns[k]
            found = float(values[k])
            if joint.name in given:
                limit = _CONTRADICTION_M if joint.slides else _CONTRADICTION_RAD
                error = given[joint.name] - found
                error = error if joint.slides else math.remainder(error, math.tau)
                if abs(error) > limit:
                    raise JointError(
                        f"position of joint {joint.name!r} is {given[joint.name]:.6g}, but its "
                        f"loop closes at {found:.6g}; expected a difference up to {limit:.3g}"
                    )
            positions[joint.name] = found
        return positions

    def drivers_to(self, link: str) -> list[str]:
        """Names of the independent joints that move ``link``, in order from the root."""
        moving = {joint.name for joint in self.path_to(link) if joint.moves}
        used = np.array([joint.name in moving for joint in self._columns], dtype=np.bool_)
        if len(self._columns):
            used |= self._in_group[used].any(axis=0)
        return [self._columns[k].name for k in self._independent.tolist() if used[k]]

    def joints_that_move(self, link: str) -> frozenset[str]:
        """Names of the moving joints on the way to ``link``, and of those that they follow."""
        return super().joints_that_move(link) | set(self.drivers_to(link))

    def jacobian(self, link: str, drivers: Sequence[str], matrices: FloatArray) -> FloatArray:
        """Return the Jacobian (6, n) as `KinematicTree.jacobian`, with the loops kept closed."""
        names = [joint.name for joint in self._columns]
        full = super().jacobian(link, names, matrices)
        of_loops = self._jacobian(matrices)
        share, *_ = np.linalg.lstsq(
            of_loops[:, self._dependent], -of_loops[:, self._independent], rcond=None
        )
        closed = full[:, self._independent] + full[:, self._dependent] @ share
        column_of = {names[k]: n for n, k in enumerate(self._independent.tolist())}
        return closed[:, [column_of[name] for name in drivers]]

    def _drivers_for(self, link: str) -> frozenset[str]:
        return frozenset(self.drivers_to(link))

    def _missing_for(self, link: str, given: Set[str]) -> Joint | None:
        missing = (name for name in self.drivers_to(link) if name not in given)
        return next(map(self.joint, missing), None)

    def _signs_of(self, closure: LoopClosure) -> Iterator[float]:
        """For each moving joint: 1 if it moves the child alone, -1 the parent alone, else 0."""
        child = {joint.name for joint in self.path_to(closure.child)}
        parent = {joint.name for joint in self.path_to(closure.parent)}
        for joint in self._columns:
            yield float(joint.name in child) - float(joint.name in parent)

    def _gap(self, closure: LoopClosure, matrices: FloatArray) -> tuple[float, float]:
        return closure.gap(
            matrices[self.link_rows[closure.parent]], matrices[self.link_rows[closure.child]]
        )

    def _residual(self, matrices: FloatArray) -> FloatArray:
        rows = self.link_rows
        return np.concatenate(
            [each.residual(matrices[rows[each.parent]], matrices[rows[each.child]])
             for each in self._closures]
        )  # fmt: skip

    def _jacobian(self, matrices: FloatArray) -> FloatArray:
        """Derivative (k, n) of the residual by the moving joints, per rad or m."""
        rows, blocks = self.link_rows, []
        frames = matrices[self._rows_of_columns]
        axes = np.einsum("nij,nj->ni", frames[:, :3, :3], self._column_axes)
        pivots = (
            np.einsum("nij,nj->ni", frames[:, :3, :3], self._column_pivots_mm) + frames[:, :3, 3]
        )
        for closure, signs in zip(self._closures, self._signs, strict=True):
            parent, child = matrices[rows[closure.parent]], matrices[rows[closure.child]]
            blocks.append(signs * closure.columns(parent, child, axes, pivots, self._column_slides))
        return np.concatenate(blocks)

    def _require_assembled(self) -> None:
        """Raise `UrdfError` if the loops close only far from position 0 of a dependent joint."""
        for k in self._dependent.tolist():
            joint, moved = self._columns[k], float(self._zero[k])
            limit = _CONTRADICTION_M if joint.slides else _CONTRADICTION_RAD
            if abs(moved) > limit:
                raise UrdfError(
                    f"joint {joint.name!r} is at {moved:.3g} where its loop closes with the other "
                    f"joints at position 0; expected at most {limit:.3g} from its own position 0"
                )

    def _choose_dependent(self, matrices: FloatArray, share: float, lever: float) -> np.ndarray:
        """Mark the joints (n,), taken from the leaves, whose columns are linearly independent.

        What is left of a column beside those marked before must be more than ``share`` of it and
        more than ``lever``, in mm per rad or m.
        """
        jacobian = self._jacobian(matrices)
        basis: list[FloatArray] = []
        is_dependent = np.zeros(len(self._columns), dtype=np.bool_)
        for k in reversed(range(len(self._columns))):
            column = jacobian[:, k]
            length = float(np.linalg.norm(column))
            if length == 0.0:
                continue
            rest = column / length
            for _ in range(2):  # twice, against rounding
                for each in basis:
                    rest = rest - (each @ rest) * each
            left = float(np.linalg.norm(rest))
            if left > share and left * length > lever:
                basis.append(rest / left)
                is_dependent[k] = True
        return is_dependent

    def _groups(self) -> np.ndarray:
        """True (n, n) for two joints that are in the same loop, or in loops that share joints."""
        touches = self._signs != 0.0
        shared = np.eye(len(self._closures), dtype=np.bool_)
        for _ in self._closures:
            shared |= (shared.astype(int) @ (touches.astype(int) @ touches.T.astype(int))) > 0
        together = touches.T.astype(int) @ shared.astype(int) @ touches.astype(int)
        return np.asarray(together > 0, dtype=np.bool_)

    def _named(self, values: FloatArray) -> dict[str, float]:
        names = (joint.name for joint in self._columns)
        return dict(zip(names, values.tolist(), strict=True))

    def _solve(self, independent: tuple[float, ...]) -> FloatArray:
        """Positions (n,) of all joints for those of the independent ones, from the zero pose."""
        goal = np.array(independent) - self._zero[self._independent]
        size = np.array(
            [_STEP_M if self._columns[k].slides else _STEP_RAD for k in self._independent]
        )
        in_loop = (self._signs != 0.0).any(axis=0)[self._independent]
        ratios = np.abs(goal[in_loop]) / size[in_loop]
        steps = max(1, math.ceil(float(ratios.max(initial=0.0))))
        if steps > _MAX_STEPS:
            names = [self._columns[k].name for k in self._independent.tolist()]
            raise JointError(
                f"joints are at {dict(zip(names, independent, strict=True))}; "
                f"expected positions within {_MAX_STEPS * _STEP_RAD:g} rad and "
                f"{_MAX_STEPS * _STEP_M:g} m for a closed loop"
            )
        values = self._zero.copy()
        for step in range(1, steps + 1):
            # Joints outside the loops do not change their residual: they move at once.
            share = np.where(in_loop, step / steps, 1.0)
            values[self._independent] = self._zero[self._independent] + share * goal
            values = self._closed(values)
        return values

    def _closed(self, values: FloatArray) -> FloatArray:
        """Move the dependent joints of ``values`` (n,) until the loops close.

        Gauss-Newton: for redundant closures of rounded numbers it ends at the smallest residual.
        """
        values, size = values.copy(), math.inf
        for _ in range(_MAX_ITERATIONS):
            matrices = self.link_matrices(self._named(values))
            residual = self._residual(matrices)
            jacobian = self._jacobian(matrices)[:, self._dependent]
            step, *_ = np.linalg.lstsq(jacobian, -residual, rcond=None)
            size = float(np.abs(step).max(initial=0.0))
            if not math.isfinite(size) or size <= 1e-15:
                break
            values[self._dependent] += step * min(1.0, 0.5 / size)
        self._require_closed(values, size)
        return values

    def _require_closed(self, values: FloatArray, size: float) -> None:
        matrices = self.link_matrices(self._named(values))
        gaps = [self._gap(closure, matrices) for closure in self._closures]
        shares = [max(mm / self._limit[0], rad / self._limit[1]) for mm, rad in gaps]
        worst = int(np.argmax(shares))
        closure, (gap_mm, gap_rad) = self._closures[worst], gaps[worst]
        if not shares[worst] <= 1.0:
            raise JointError(
                f"joint {closure.name!r} between {closure.parent!r} and {closure.child!r} does not "
                f"close its loop: {gap_mm:.3g} mm and {math.degrees(gap_rad):.3g} degrees apart; "
                f"expected at most {self._limit[0]:g} mm and {math.degrees(self._limit[1]):.3g} "
                "degrees"
            )
        if not size < 1e-9:
            raise JointError(
                f"joint {closure.name!r} between {closure.parent!r} and {closure.child!r} has a "
                f"loop whose positions did not settle in {_MAX_ITERATIONS} steps of Newton's "
                "method; expected positions away from its singular ones"
            )
