"""The joints of an ADF: where they put their bodies at position 0, and which of them close loops.

A joint's frame is at ``parent pivot`` of the parent and at ``child pivot`` of the child. At
position 0 the shortest rotation turns ``child axis`` to ``parent axis``, and the offsets turn the
child further about it, as the simulator builds its constraints. Where that agrees with the bodies'
locations up to the rounding of the file, the locations are used, which have more digits.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from app.geometry import FloatArray, Transform
from app.robot.adf import AdfSection
from app.robot.elements import MM_PER_M, AdfError, ClosureType, Joint, JointType, LoopClosure

REVOLUTE_TYPES = ("hinge", "revolute", "continuous", "torsion spring", "torsional spring")
PRISMATIC_TYPES = ("slider", "prismatic", "linear spring", "spring")
BALL_TYPES = ("p2p", "point2point", "point to point")
PIVOT_TOLERANCE_MM = 2.0
AXIS_TOLERANCE_RAD = math.radians(1.0)

_Z = np.array([0.0, 0.0, 1.0])
_OFFSETS = ("joint offset", "child offset", "offset")
_OPPOSITE_RAD = 3.13
"""Axes at a larger angle are opposite: the simulator's fixed choice of a rotation by pi applies,
because the axis of the shortest one is rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class AdfJoint:
    """A joint section, checked. Poses (4, 4) are in mm, axes unit vectors.

    ``parent_from_child`` is the child's pose at position 0, ``at_frames`` that at which the joint's
    own frames meet, which differs by the rounding of the file; ``note`` a sentence on a deviation.
    """

    name: str
    place: str
    kind: str
    parent: str
    child: str
    parent_from_child: FloatArray
    at_frames: FloatArray
    axis: FloatArray
    pivot_mm: FloatArray
    lower: float
    upper: float
    note: str | None

    @property
    def is_ball(self) -> bool:
        """True for a point-to-point joint, which has three degrees of freedom."""
        return self.kind in BALL_TYPES

    def joint(self) -> Joint:
        """Return the joint as part of the tree; not for a point-to-point joint."""
        origin = Transform.from_matrix(
            self.parent_from_child, target=self.parent, source=self.child
        )
        if self.kind == "fixed":
            return Joint(self.name, JointType.FIXED, origin, _Z)
        revolute = JointType.CONTINUOUS if math.isinf(self.lower) else JointType.REVOLUTE
        kind = JointType.PRISMATIC if self.kind in PRISMATIC_TYPES else revolute
        return Joint(
            self.name, kind, origin, self.axis, self.lower, self.upper, pivot_mm=self.pivot_mm
        )

    def closure(self) -> LoopClosure:
        """Return the joint as the one at which a loop is cut."""
        if self.is_ball:
            kind = ClosureType.BALL
        elif self.kind == "fixed":
            kind = ClosureType.FIXED
        elif self.kind in PRISMATIC_TYPES:
            kind = ClosureType.PRISMATIC
        else:
            kind = ClosureType.REVOLUTE
        child_from_joint = np.eye(4)
        child_from_joint[:3, :3] = shortest_rotation(_Z, self.axis)
        child_from_joint[:3, 3] = self.pivot_mm
        parent_from_joint = self.at_frames @ child_from_joint
        return LoopClosure(
            self.name, kind, self.parent, self.child, parent_from_joint, child_from_joint
        )


def read_joint(
    section: AdfSection,
    name: str,
    parent: tuple[str, FloatArray],
    child: tuple[str, FloatArray],
) -> AdfJoint:
    """Read the joint between two links, given by name and location (4, 4) in m.

    Raises `AdfError`, naming joint and bodies, for a type of several degrees of freedom other than
    point-to-point and for malformed numbers.
    """
    kind = section.text("type").lower()
    place = f"{section.place}, between {parent[0]!r} and {child[0]!r}"
    if kind not in (*REVOLUTE_TYPES, *PRISMATIC_TYPES, *BALL_TYPES, "fixed"):
        raise AdfError(
            f"{place} has the type {section.text('type')!r}; expected one of "
            f"{', '.join((*REVOLUTE_TYPES, *PRISMATIC_TYPES, *BALL_TYPES))} or fixed"
        )
    by_location = np.asarray(np.linalg.solve(parent[1], child[1]), dtype=np.float64)
    by_location[:3, 3] *= MM_PER_M
    has_frames = "parent axis" in section and "parent pivot" in section
    pivot_mm, axis = np.zeros(3), _Z
    if kind != "fixed" or "child pivot" in section:
        pivot_mm = MM_PER_M * section.inside("child pivot").numbers("xyz")
    if kind not in (*BALL_TYPES, "fixed") or "child axis" in section:
        axis = _unit(section, "child axis")
    note, matrix, at_frames = None, by_location, by_location
    if has_frames and kind != "fixed":
        at_frames = _by_constraint(section, axis, pivot_mm)
        matrix, note = _preferred(place, kind, by_location, at_frames, pivot_mm)
    lower, upper = -math.inf, math.inf
    limits = section.inside("joint limits")
    if "low" in limits and "high" in limits and kind not in BALL_TYPES:
        lower, upper = limits.number("low"), limits.number("high")
    return AdfJoint(
        name,
        section.place,
        kind,
        parent[0],
        child[0],
        matrix,
        at_frames,
        axis,
        pivot_mm,
        lower,
        upper,
        note,
    )


def _by_constraint(section: AdfSection, axis: FloatArray, pivot_mm: FloatArray) -> FloatArray:
    """Pose (4, 4) of the child in its parent, in mm, with the joint's frames at position 0."""
    parent_axis = _unit(section, "parent axis")
    parent_pivot_mm = MM_PER_M * section.inside("parent pivot").numbers("xyz")
    offset = sum(section.number(key, 0.0) for key in _OFFSETS if key in section)
    turn = Rotation.from_rotvec(offset * parent_axis).as_matrix()
    matrix = np.eye(4)
    matrix[:3, :3] = turn @ shortest_rotation(axis, parent_axis)
    matrix[:3, 3] = parent_pivot_mm - matrix[:3, :3] @ pivot_mm
    return matrix


def _preferred(
    place: str, kind: str, by_location: FloatArray, at_zero: FloatArray, pivot_mm: FloatArray
) -> tuple[FloatArray, str | None]:
    """The pose at position 0, and a note where locations and joint disagree."""
    gap = by_location[:3, :3] @ pivot_mm + by_location[:3, 3]
    gap = gap - at_zero[:3, :3] @ pivot_mm - at_zero[:3, 3]
    distance_mm = float(np.linalg.norm(gap))
    turn = Rotation.from_matrix(by_location[:3, :3].T @ at_zero[:3, :3]).magnitude()
    angle = 0.0 if kind in BALL_TYPES else float(turn)
    if distance_mm <= PIVOT_TOLERANCE_MM and angle <= AXIS_TOLERANCE_RAD:
        return by_location, None
    if kind in BALL_TYPES:  # its axes mean nothing: the location gives the rotation
        at_zero = by_location.copy()
        at_zero[:3, 3] -= gap
    return at_zero, (
        f"{place}: with the bodies at their locations the pivots are {distance_mm:.3g} mm and the "
        f"joint {math.degrees(angle):.3g} degrees from position 0; the pivots, axes and offsets of "
        "the joint are used, as in the simulator"
    )


def spanning_tree(
    joints: Sequence[AdfJoint], roots: Sequence[str]
) -> tuple[list[AdfJoint], list[AdfJoint]]:
    """Return the joints of the tree and those that close loops, each in file order.

    A body keeps the first of its joints that is not point-to-point, where it has one. ``roots`` are
    the links without a joint to a parent. Raises `AdfError` for bodies that no root leads to.
    """
    kept: dict[str, AdfJoint] = {}
    for joint in joints:
        if joint.child not in kept or (kept[joint.child].is_ball and not joint.is_ball):
            kept[joint.child] = joint
    tree = [joint for joint in joints if kept[joint.child] is joint]
    children: dict[str, list[str]] = {}
    for joint in tree:
        children.setdefault(joint.parent, []).append(joint.child)
    reached = list(roots)
    for link in reached:  # grows in the loop
        reached.extend(children.get(link, []))
    left = [joint.child for joint in tree if joint.child not in set(reached)]
    if left:
        raise AdfError(
            f"{joints[0].place.rsplit(': ', 1)[0]}: the bodies {', '.join(map(repr, left))} are "
            "children of each other in a loop; expected a body without a parent joint"
        )
    return tree, [joint for joint in joints if kept[joint.child] is not joint]


def split_ball(joint: AdfJoint) -> tuple[list[str], list[Joint]]:
    """Return the two further links and three hinges that a point-to-point joint is modelled as.

    The hinges rotate about x, y and z of the child through its pivot, in this order from the
    parent, and are named after the joint with ``-x``, ``-y`` and ``-z``.
    """
    links = [f"{joint.child}-{joint.name}-{axis}" for axis in "xy"]
    chain = [joint.parent, *links, joint.child]
    joints = []
    for number, axis in enumerate("xyz"):
        matrix = joint.parent_from_child if number == 0 else np.eye(4)
        origin = Transform.from_matrix(matrix, target=chain[number], source=chain[number + 1])
        joints.append(
            Joint(
                f"{joint.name}-{axis}",
                JointType.CONTINUOUS,
                origin,
                np.eye(3)[number],
                pivot_mm=joint.pivot_mm,
            )
        )
    return links, joints


def shortest_rotation(start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the shortest rotation (3, 3) of the unit vector ``start`` (3,) to ``end`` (3,).

    For opposite vectors, a rotation by pi about ``start`` x X, or about ``start`` x Y where
    ``start`` is along X.
    """
    angle = math.atan2(float(np.linalg.norm(np.cross(start, end))), float(start @ end))
    if angle > _OPPOSITE_RAD:
        side = np.eye(3)[0]
        if np.linalg.norm(np.cross(start, side)) < math.sin(0.1):
            side = np.eye(3)[1]
        across = np.cross(start, side)
        half_turn = Rotation.from_rotvec(math.pi * across / np.linalg.norm(across)).as_matrix()
        return np.asarray(_small_rotation(-start, end) @ half_turn, dtype=np.float64)
    return _small_rotation(start, end)


def _small_rotation(start: FloatArray, end: FloatArray) -> FloatArray:
    """Shortest rotation between unit vectors that are not opposite."""
    x, y, z = np.cross(start, end).tolist()
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    matrix = np.eye(3) + skew + skew @ skew / (1.0 + float(start @ end))
    return np.asarray(matrix, dtype=np.float64)


def _unit(section: AdfSection, key: str) -> FloatArray:
    values = section.inside(key).numbers("xyz")
    length = float(np.linalg.norm(values))
    if not 1e-9 <= length < math.inf:
        raise AdfError(f"{section.place}: {key!r} is {values.tolist()}; expected a direction")
    return np.asarray(values / length, dtype=np.float64)
