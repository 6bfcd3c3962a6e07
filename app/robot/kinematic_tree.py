"""The tree of links and joints: link poses and their Jacobian."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray, Transform
from app.robot.elements import MM_PER_M, Joint, JointError, UrdfError

_JacobianJoints = tuple[
    NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_], FloatArray, FloatArray, FloatArray
]
"""Values of m joints: row of the child, column, `slides`, gain (m,); axis, pivot in mm (m, 3)."""


class KinematicTree:
    """Joints, sorted from root to leaves, that form one tree over ``link_names``.

    Raises `UrdfError` for several roots, a loop, a link with two parents, a joint of an unknown
    link, and a mimic joint without leader or in a loop of mimics. ``dependent``: names of the
    joints that follow from the others because they close loops, none here (see `ClosedTree`).
    """

    def __init__(self, link_names: Sequence[str], joints: Sequence[Joint]) -> None:
        self.root = _root_of(link_names, joints)
        self.joints = _sorted_from_root(self.root, link_names, joints)
        self.link_names = (self.root, *(joint.child for joint in self.joints))
        self._joint_named = {joint.name: joint for joint in joints}
        self._parent_joint = {joint.child: joint for joint in joints}
        self.link_rows = {name: row for row, name in enumerate(self.link_names)}
        self._drivers = tuple(joint.name if joint.moves else None for joint in self.joints)
        self._slides = np.array([joint.slides for joint in self.joints], dtype=np.bool_)
        self._parents = np.array([self.link_rows[joint.parent] for joint in self.joints], np.int64)
        self._origins = np.array([joint.origin.matrix for joint in self.joints]).reshape(-1, 4, 4)
        twists = np.array([joint.twist for joint in self.joints]).reshape(-1, 4, 4)
        first = self._origins @ twists
        self._motions = np.array([first, first @ twists])
        self._leaders_first = tuple(
            (joint.name, joint.mimic) for joint in _leaders_first(joints, self._joint_named)
        )
        self._moving = frozenset(name for name, _ in self._leaders_first)
        self._drivers_of: dict[str, frozenset[str]] = {}
        self._in_jacobian: dict[tuple[str, tuple[str, ...]], _JacobianJoints] = {}
        self.dependent: frozenset[str] = frozenset()

    def joint(self, name: str) -> Joint:
        """Return the moving joint ``name``; raise `JointError` for a fixed or an unknown one."""
        joint = self._joint_named.get(name)
        if joint is None or not joint.moves:
            moving = ", ".join(joint.name for joint in self.joints if joint.moves) or "none"
            found = "is fixed" if joint else "is unknown"
            raise JointError(f"joint {name!r} {found}; expected a moving joint: {moving}")
        return joint

    def complete_positions(self, given: Mapping[str, float]) -> dict[str, float]:
        """Return the position of every moving joint: given, else from its leader, else 0.

        A given position of a mimic joint, which a driver may report as measured, takes precedence
        over its leader's, as in robot_state_publisher. Raises `JointError` for an unknown joint and
        for a position that is not finite.
        """
        if not (given.keys() <= self._moving and all(map(math.isfinite, given.values()))):
            self._raise_invalid(given)
        positions: dict[str, float] = {}
        for name, mimic in self._leaders_first:
            if name in given:
                positions[name] = float(given[name])
            elif mimic is not None:
                positions[name] = mimic.multiplier * positions[mimic.leader] + mimic.offset
            else:
                positions[name] = 0.0
        return positions

    def link_matrices(self, positions: Mapping[str, float]) -> FloatArray:
        """Return ``root_from_link`` (n, 4, 4) in mm, in the order of ``link_names``.

        ``positions`` are those of `complete_positions`. Raises `JointError` when a pose overflows.
        """
        values = np.array([0.0 if name is None else positions[name] for name in self._drivers])
        matrices = np.empty((len(values) + 1, 4, 4))
        if not _load_kernels()[0](
            values, self._slides, self._origins, self._motions, self._parents, matrices
        ):
            origins_mm = matrices[:, :3, 3]
            first = int(np.argmin(np.isfinite(origins_mm).all(axis=1)))
            raise JointError(
                f"link {self.link_names[first]!r} is at {origins_mm[first].tolist()} mm with the "
                f"joints at {dict(positions)}; expected finite numbers"
            )
        return matrices

    def _raise_invalid(self, given: Mapping[str, float]) -> None:
        """Raise `JointError` for the first invalid position."""
        for name, position in given.items():
            self.joint(name)
            if not math.isfinite(position):
                raise JointError(
                    f"position of joint {name!r} is {position}; expected a finite number"
                )

    def require_positions_for(self, link: str, given: Mapping[str, float]) -> None:
        """Raise `JointError` unless all joints that move ``link`` are given or follow given."""
        missing = self._missing_for(link, given.keys())
        if missing is not None:
            raise JointError(
                f"joint {self.driver_of(missing)[0]!r}, which moves {link!r}, has no position; "
                f"expected {', '.join(sorted(self._drivers_for(link)))}, "
                f"found {', '.join(given) or 'none'}"
            )

    def is_determined(self, link: str, given: Set[str]) -> bool:
        """True if all joints that move ``link`` are among ``given`` or follow one that is."""
        return self._missing_for(link, given) is None

    def joints_that_move(self, link: str) -> frozenset[str]:
        """Names of the moving joints between the root and ``link``, and of all that they follow."""
        path = [joint for joint in self.path_to(link) if joint.moves]
        return frozenset(each.name for joint in path for each in self._with_leaders(joint))

    def drivers_to(self, link: str) -> list[str]:
        """Names of the actuated joints that move ``link``, in order from the root."""
        path = [joint for joint in self.path_to(link) if joint.moves]
        return list(dict.fromkeys(self.driver_of(joint)[0] for joint in path))

    def _drivers_for(self, link: str) -> frozenset[str]:
        drivers = self._drivers_of.get(link)
        if drivers is None:
            drivers = self._drivers_of[link] = frozenset(self.drivers_to(link))
        return drivers

    def _missing_for(self, link: str, given: Set[str]) -> Joint | None:
        """The first joint on the way to ``link`` that ``given`` does not determine."""
        if self._drivers_for(link) <= given:
            return None
        for joint in self.path_to(link):
            if joint.moves and all(each.name not in given for each in self._with_leaders(joint)):
                return joint
        return None

    def _with_leaders(self, joint: Joint) -> Iterator[Joint]:
        """``joint`` and those that it follows, directly or through others."""
        yield joint
        while joint.mimic is not None:
            joint = self._joint_named[joint.mimic.leader]
            yield joint

    def path_to(self, link: str) -> list[Joint]:
        """Return the joints from the root to ``link``; raise `JointError` for an unknown link."""
        if link not in self.link_names:
            raise JointError(
                f"link {link!r} is unknown; expected one of {', '.join(self.link_names)}"
            )
        path = []
        while link != self.root:
            joint = self._parent_joint[link]
            path.append(joint)
            link = joint.parent
        return path[::-1]

    def driver_of(self, joint: Joint) -> tuple[str, float]:
        """Return the actuated joint that ``joint`` follows, and the product of the multipliers."""
        gain = 1.0
        while joint.mimic is not None:
            gain *= joint.mimic.multiplier
            joint = self._joint_named[joint.mimic.leader]
        return joint.name, gain

    def jacobian(self, link: str, drivers: Sequence[str], matrices: FloatArray) -> FloatArray:
        """Return the geometric Jacobian (6, n) of ``link`` for ``drivers``, in the root frame.

        Rows are the velocity of the link's origin (mm), then its angular velocity (rad), per rad or
        m of the driver (Siciliano et al., Robotics, 2009, section 3.1). The motion of mimic joints
        is part of their driver's column. ``matrices`` are those of `link_matrices`.
        """
        jacobian = np.zeros((6, len(drivers)))
        _load_kernels()[1](
            matrices,
            self.link_rows[link],
            *self._joints_in_jacobian(link, tuple(drivers)),
            jacobian,
        )
        return jacobian

    def compiled_arrays(
        self, link: str, drivers: tuple[str, ...]
    ) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """Arguments of `link_kernel` for the poses, and those for the Jacobian of ``link``."""
        poses = (self._slides, self._origins, self._motions, self._parents)
        return poses, (self.link_rows[link], *self._joints_in_jacobian(link, drivers))

    def _joints_in_jacobian(self, link: str, drivers: tuple[str, ...]) -> _JacobianJoints:
        """Joints that move ``link`` and follow one of ``drivers``."""
        found = self._in_jacobian.get((link, drivers))
        if found is None:
            path = [(joint, *self.driver_of(joint)) for joint in self.path_to(link) if joint.moves]
            used = [(joint, name, gain) for joint, name, gain in path if name in drivers]
            found = (
                np.array([self.link_rows[joint.child] for joint, _, _ in used], np.int64),
                np.array([drivers.index(name) for _, name, _ in used], np.int64),
                np.array([joint.slides for joint, _, _ in used], np.bool_),
                np.array([gain * (MM_PER_M if joint.slides else 1.0) for joint, _, gain in used]),
                np.array([joint.axis for joint, _, _ in used]).reshape(-1, 3),
                np.array([joint.pivot_mm for joint, _, _ in used]).reshape(-1, 3),
            )
            self._in_jacobian[link, drivers] = found
        return found


@cache
def _load_kernels() -> tuple[Callable[..., bool], Callable[..., None]]:
    from app.robot.link_kernel import compute_jacobian, compute_link_poses  # slow

    return compute_link_poses, compute_jacobian


def _root_of(link_names: Sequence[str], joints: Sequence[Joint]) -> str:
    known = set(link_names)
    parent_joint: dict[str, str] = {}
    for joint in joints:
        for role, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in known:
                raise UrdfError(
                    f"{role} {link!r} of joint {joint.name!r} is not a link; expected one"
                )
        if joint.child in parent_joint:
            raise UrdfError(
                f"link {joint.child!r} is the child of the joints {parent_joint[joint.child]!r} "
                f"and {joint.name!r}; expected one parent joint"
            )
        parent_joint[joint.child] = joint.name
    roots = [name for name in link_names if name not in parent_joint]
    if not roots:
        raise UrdfError("the links form a loop; expected one link without a parent joint")
    if len(roots) > 1:
        raise UrdfError(f"the links {', '.join(roots)} have no parent joint; expected one root")
    return roots[0]


def _sorted_from_root(
    root: str, link_names: Sequence[str], joints: Sequence[Joint]
) -> tuple[Joint, ...]:
    child_joints: dict[str, list[Joint]] = {}
    for joint in joints:
        child_joints.setdefault(joint.parent, []).append(joint)
    ordered: list[Joint] = []
    links = [root]
    for link in links:  # grows in the loop: breadth first
        ordered.extend(child_joints.get(link, []))
        links.extend(joint.child for joint in child_joints.get(link, []))
    unreached = sorted(set(link_names) - set(links))
    if unreached:
        raise UrdfError(
            f"the links {', '.join(unreached)} form a loop that is not connected to {root!r}"
        )
    return tuple(ordered)


def _leaders_first(joints: Sequence[Joint], named: Mapping[str, Joint]) -> tuple[Joint, ...]:
    """Moving joints, every mimic joint after its leader."""
    ordered: dict[str, Joint] = {}
    for joint in joints:
        chain: list[Joint] = []
        while joint.moves and joint.name not in ordered:
            if joint in chain:
                raise UrdfError(
                    f"joint {joint.name!r} mimics itself, directly or through others; expected "
                    "another joint"
                )
            chain.append(joint)
            if joint.mimic is None:
                break
            leader = named.get(joint.mimic.leader)
            if leader is None or not leader.moves:
                raise UrdfError(
                    f"joint {joint.name!r} mimics {joint.mimic.leader!r}; expected a moving joint"
                )
            joint = leader
        ordered.update((joint.name, joint) for joint in reversed(chain))
    return tuple(ordered.values())


class LinkPoses(Mapping[str, Transform]):
    """``root_from_link`` by link, each converted when it is accessed.

    A session computes all links at every step and reads one of them.
    """

    __slots__ = ("_matrices", "_root", "_rows")

    def __init__(self, root: str, rows: Mapping[str, int], matrices: FloatArray) -> None:
        """Take over ``matrices`` (n, 4, 4): rigid, in mm, not copied and not checked.

        ``rows`` maps a link to its index in ``matrices``.
        """
        self._root = root
        self._rows = rows
        self._matrices = matrices

    @classmethod
    def of(cls, links: Mapping[str, Transform]) -> "LinkPoses":
        """``links`` as they are, or with their matrices; there is at least one."""
        if isinstance(links, LinkPoses):
            return links
        matrices = np.array([each.matrix for each in links.values()])
        root = next(iter(links.values())).target
        return cls(root, {name: number for number, name in enumerate(links)}, matrices)

    @property
    def root(self) -> str:
        """The link that the poses are in."""
        return self._root

    @property
    def matrices(self) -> FloatArray:
        """Matrices (n, 4, 4) in the order of the names."""
        rows: FloatArray = self._matrices[list(self._rows.values())]
        return rows

    def matrix(self, link: str) -> FloatArray:
        """The matrix (4, 4) of ``link``."""
        found: FloatArray = self._matrices[self._rows[link]]
        return found

    def __getitem__(self, link: str) -> Transform:
        matrix = self.matrix(link)
        return Transform.unchecked(self._root, link, matrix[:3, :3], matrix[:3, 3])

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)
