"""The tree of links and joints: where every link is, and how joints move it."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache

import numpy as np

from app.geometry import FloatArray
from app.robot.errors import JointError, UrdfError
from app.robot.kinematics.joint import MM_PER_M, Joint


class KinematicTree:
    """Joints in the order from root to leaves, checked to be one tree over ``link_names``.

    Several roots, a loop, a link with two parents, a joint at a link that does not exist and a
    mimic joint that follows nobody or itself raise `UrdfError`.
    """

    def __init__(self, link_names: Sequence[str], joints: Sequence[Joint]) -> None:
        self.root = _root_of(link_names, joints)
        self.joints = _from_root_to_leaves(self.root, link_names, joints)
        self.link_names = (self.root, *(joint.child for joint in self.joints))
        self._joint_named = {joint.name: joint for joint in joints}
        self._joint_above = {joint.child: joint for joint in joints}
        self.link_rows = {name: row for row, name in enumerate(self.link_names)}
        self._drivers = tuple(joint.name if joint.moves else None for joint in self.joints)
        self._slides = np.array([joint.slides for joint in self.joints], dtype=np.bool_)
        self._parents = np.array([self.link_rows[joint.parent] for joint in self.joints], np.int64)
        self._origins = np.array([joint.origin.matrix for joint in self.joints]).reshape(-1, 4, 4)
        twists = np.array([joint.twist for joint in self.joints]).reshape(-1, 4, 4)
        turned = self._origins @ twists
        self._turned = np.array([turned, turned @ twists])
        self._leaders_first = tuple(
            (joint.name, joint.mimic) for joint in _leaders_first(joints, self._joint_named)
        )
        self._moving = frozenset(name for name, _ in self._leaders_first)
        self._drivers_of: dict[str, frozenset[str]] = {}

    def joint(self, name: str) -> Joint:
        """The moving joint of that name; `JointError` for a fixed or an unknown one."""
        joint = self._joint_named.get(name)
        if joint is None or not joint.moves:
            moving = ", ".join(joint.name for joint in self.joints if joint.moves) or "none"
            found = "is fixed" if joint else "is unknown"
            raise JointError(f"joint {name!r} {found}: the robot's moving joints are {moving}")
        return joint

    def all_positions(self, given: Mapping[str, float]) -> dict[str, float]:
        """Positions of every moving joint: given ones, then followers of leaders, the rest at 0.

        A mimic joint that is itself given (a driver may report it as measured) stays as given,
        as in robot_state_publisher.
        """
        if not (given.keys() <= self._moving and all(map(math.isfinite, given.values()))):
            self._refuse(given)
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
        """``root_from_link`` (n, 4, 4) in mm, as in ``link_names``, from `all_positions`.

        Raises `JointError` for positions that put a link beyond all numbers.
        """
        each = np.array([0.0 if name is None else positions[name] for name in self._drivers])
        matrices = np.empty((len(each) + 1, 4, 4))
        place_links = _placing()
        if not place_links(
            each, self._slides, self._origins, self._turned, self._parents, matrices
        ):
            places_mm = matrices[:, :3, 3]
            first = int(np.argmin(np.isfinite(places_mm).all(axis=1)))
            raise JointError(
                f"link {self.link_names[first]!r} is at {places_mm[first].tolist()} mm with the "
                f"joints at {dict(positions)}: finite numbers wanted"
            )
        return matrices

    def _refuse(self, given: Mapping[str, float]) -> None:
        """Raise `JointError` for the first of the positions that cannot be taken."""
        for name, position in given.items():
            self.joint(name)
            if not math.isfinite(position):
                raise JointError(
                    f"position of joint {name!r} is {position}: a finite number wanted"
                )

    def require_all_of(self, link: str, given: Mapping[str, float]) -> None:
        """Raise `JointError` for a joint that moves ``link``, and neither it nor who it follows is
        ``given``.
        """
        drivers = self._drivers_of.get(link)
        if drivers is None:
            path = [joint for joint in self.path_to(link) if joint.moves]
            drivers = self._drivers_of[link] = frozenset(self.driver_of(each)[0] for each in path)
        if drivers <= given.keys():
            return
        for joint in self.path_to(link):
            if joint.moves and not self._is_told(joint, given):
                raise JointError(
                    f"joint {self.driver_of(joint)[0]!r}, which moves {link!r}, has no position: "
                    f"{', '.join(given) or 'none'} given, {', '.join(sorted(drivers))} wanted"
                )

    def _is_told(self, joint: Joint, given: Mapping[str, float]) -> bool:
        while joint.name not in given and joint.mimic is not None:
            joint = self._joint_named[joint.mimic.leader]
        return joint.name in given

    def path_to(self, link: str) -> list[Joint]:
        """The joints from the root to ``link``; `JointError` for an unknown link."""
        if link not in self.link_names:
            raise JointError(
                f"link {link!r} is unknown: the links are {', '.join(self.link_names)}"
            )
        path = []
        while link != self.root:
            joint = self._joint_above[link]
            path.append(joint)
            link = joint.parent
        return path[::-1]

    def driver_of(self, joint: Joint) -> tuple[str, float]:
        """The actuated joint that a moving one follows in the end, and how much of it it moves."""
        gain = 1.0
        while joint.mimic is not None:
            gain *= joint.mimic.multiplier
            joint = self._joint_named[joint.mimic.leader]
        return joint.name, gain

    def jacobian(self, link: str, drivers: Sequence[str], matrices: FloatArray) -> FloatArray:
        """How ``link`` moves with ``drivers``: (6, n), mm and rad per rad (or per m), in the root.

        Rows are the velocity of the link's origin, then its angular velocity (the geometric
        Jacobian; Siciliano et al., Robotics, 2009, section 3.1). A driver also moves through the
        joints that follow it.
        """
        jacobian = np.zeros((6, len(drivers)))
        column_of = {name: column for column, name in enumerate(drivers)}
        origin = matrices[self.link_rows[link]][:3, 3]
        for joint in self.path_to(link):
            if not joint.moves:
                continue
            driver, gain = self.driver_of(joint)
            column = column_of.get(driver)
            if column is None:
                continue
            # A motion leaves its own axis where it is, so the child's frame serves for it.
            child = matrices[self.link_rows[joint.child]]
            axis = child[:3, :3] @ joint.axis
            if joint.slides:
                jacobian[:3, column] += gain * MM_PER_M * axis
            else:
                lever = origin - (child[:3, :3] @ joint.pivot_mm + child[:3, 3])
                jacobian[:3, column] += gain * np.cross(axis, lever)
                jacobian[3:, column] += gain * axis
        return jacobian


@cache
def _placing() -> Callable[..., bool]:
    from app.robot.kinematics.placing import place_links  # compiled: slow to load

    return place_links


def _root_of(link_names: Sequence[str], joints: Sequence[Joint]) -> str:
    known = set(link_names)
    above: dict[str, str] = {}
    for joint in joints:
        for role, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in known:
                raise UrdfError(f"{role} {link!r} of joint {joint.name!r} is not a link")
        if joint.child in above:
            raise UrdfError(
                f"link {joint.child!r} is the child of the joints {above[joint.child]!r} and "
                f"{joint.name!r}: one parent wanted"
            )
        above[joint.child] = joint.name
    roots = [name for name in link_names if name not in above]
    if not roots:
        raise UrdfError("the links form a loop: one link without a parent joint wanted")
    if len(roots) > 1:
        raise UrdfError(f"the links {', '.join(roots)} have no parent joint: one root wanted")
    return roots[0]


def _from_root_to_leaves(
    root: str, link_names: Sequence[str], joints: Sequence[Joint]
) -> tuple[Joint, ...]:
    below: dict[str, list[Joint]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint)
    ordered: list[Joint] = []
    links = [root]
    for link in links:  # grows while it is walked: breadth first
        ordered.extend(below.get(link, []))
        links.extend(joint.child for joint in below.get(link, []))
    unreached = sorted(set(link_names) - set(links))
    if unreached:
        raise UrdfError(f"the links {', '.join(unreached)} form a loop apart from {root!r}")
    return tuple(ordered)


def _leaders_first(joints: Sequence[Joint], named: Mapping[str, Joint]) -> tuple[Joint, ...]:
    """Moving joints such that every mimic joint comes after the one it follows."""
    ordered: dict[str, Joint] = {}
    for joint in joints:
        chain: list[Joint] = []
        while joint.moves and joint.name not in ordered:
            if joint in chain:
                raise UrdfError(f"joint {joint.name!r} mimics itself by way of others")
            chain.append(joint)
            if joint.mimic is None:
                break
            leader = named.get(joint.mimic.leader)
            if leader is None or not leader.moves:
                raise UrdfError(
                    f"joint {joint.name!r} mimics {joint.mimic.leader!r}: a moving joint wanted"
                )
            joint = leader
        ordered.update((joint.name, joint) for joint in reversed(chain))
    return tuple(ordered.values())
