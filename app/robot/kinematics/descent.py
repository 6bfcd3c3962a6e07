"""Compiled descent of inverse kinematics, for a link of a tree without closed loops.

The arrays of a link are computed once for each tree: an arm that follows a path asks thousands of
times.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from app.geometry import FloatArray, Transform
from app.robot.kinematics.tree import KinematicTree

if TYPE_CHECKING:
    from app.robot.kinematics.inverse import IkOptions

_of_tree: "WeakKeyDictionary[KinematicTree, dict[str, Descent]]" = WeakKeyDictionary()


class Descent:
    """Descends from joint positions to a pose of ``link``; ``names`` are the joints that move it.

    Raises `JointError` for an unknown link.
    """

    def __init__(self, tree: KinematicTree, link: str, names: Sequence[str]) -> None:
        self._tree, self._names = tree, tuple(names)
        joints = [tree.driver_of(each) if each.moves else ("", 0.0) for each in tree.joints]
        drivers = [names.index(driver) if driver in names else -1 for driver, _ in joints]
        self._moving = [joint.name if joint.moves else None for joint in tree.joints]
        self._before: tuple[Any, ...] = (
            np.array(drivers, np.int64),
            np.array([gain for _, gain in joints]),
        )
        self._arrays = tree.compiled_arrays(link, self._names)

    def run(
        self,
        fixed: Mapping[str, float],
        start: FloatArray,
        bounds: tuple[FloatArray, FloatArray],
        goal: Transform,
        weight: float,
        options: "IkOptions",
        min_cost_drop: float,
    ) -> tuple[FloatArray, FloatArray] | None:
        """The positions (n,) of a local minimum, and its error (6,), mm and ``weight`` times rad.

        None if a pose on the way is not finite. ``fixed`` are positions of other joints, ``bounds``
        the limits (n,) of the joints.
        """
        base = self._tree.complete_positions({**fixed, **dict.fromkeys(self._names, 0.0)})
        offsets = np.array([0.0 if name is None else base[name] for name in self._moving])
        found, error = np.empty(len(start)), np.empty(6)
        finite = _load_kernel()(
            np.ascontiguousarray(start, dtype=np.float64),
            *bounds,
            goal.matrix,
            offsets,
            *self._before,
            *self._arrays,
            weight,
            options.tolerance_mm,
            options.tolerance_rad,
            options.max_iterations,
            min_cost_drop,
            found,
            error,
        )
        return (found, error) if finite else None


def descent_of(tree: KinematicTree, link: str, names: Sequence[str]) -> Descent:
    """The descent to poses of ``link``, made once for each tree."""
    descents = _of_tree.setdefault(tree, {})
    if link not in descents:
        descents[link] = Descent(tree, link, names)
    return descents[link]


@cache
def _load_kernel() -> Any:
    from app.robot.kinematics.link_kernel import descend  # slow

    return descend
