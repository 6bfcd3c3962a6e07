"""A robot: links with shapes, joints, forward and inverse kinematics."""

from collections.abc import Mapping, Set
from dataclasses import dataclass, field

from app.geometry import FloatArray, FrameError, Transform
from app.robot.closed_tree import ClosedTree
from app.robot.elements import Joint, Link, LoopClosure
from app.robot.inverse_kinematics import IkOptions, inverse_kinematics
from app.robot.kinematic_tree import KinematicTree, LinkPoses


@dataclass(frozen=True, slots=True, eq=False)
class Robot:
    """A tree of links, made by `load_robot` or from links and joints.

    ``closures`` are joints that close loops of links; the joints that follow from them are not
    actuated.
    ``warnings`` has one sentence for each deviation from the file, such as a missing display mesh.
    ``links_without_collision`` names the links whose collision meshes could not be read: nothing
    may be concluded from the absence of a collision with them.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    warnings: tuple[str, ...] = ()
    links_without_collision: tuple[str, ...] = ()
    closures: tuple[LoopClosure, ...] = ()
    actuated_joint_names: tuple[str, ...] = field(init=False, repr=False)
    """The joints that are not fixed and follow no other joint, in file order."""
    _tree: KinematicTree = field(init=False, repr=False)

    def __post_init__(self) -> None:
        names = [link.name for link in self.links]
        tree = (
            ClosedTree(names, self.joints, self.closures)
            if self.closures
            else KinematicTree(names, self.joints)
        )
        object.__setattr__(self, "_tree", tree)
        free = [joint.name for joint in self.joints if joint.moves and joint.mimic is None]
        actuated = tuple(name for name in free if name not in tree.dependent)
        object.__setattr__(self, "actuated_joint_names", actuated)

    @property
    def root_link(self) -> str:
        """The link without a parent joint."""
        return self._tree.root

    @property
    def tree(self) -> KinematicTree:
        """The links and joints in their order from the root, for compiled code."""
        return self._tree

    @property
    def dependent_joint_names(self) -> tuple[str, ...]:
        """The joints whose positions follow from closed loops, in file order."""
        return tuple(j.name for j in self.joints if j.name in self._tree.dependent)

    @property
    def loop_gaps(self) -> tuple[tuple[float, float], ...]:
        """For each of ``closures`` the gap (mm, rad) that is left with the joints at 0."""
        return self._tree.gaps if isinstance(self._tree, ClosedTree) else ()

    def forward_kinematics(self, positions: Mapping[str, float]) -> LinkPoses:
        """Return ``root_from_link`` in mm for every link.

        ``positions`` are in rad (m for sliding joints). A joint without position is at 0. A mimic
        joint without position follows its leader, and a joint of a closed loop the others. Limits
        are not applied, because a measured position can be outside of them. Raises `JointError`
        for a name that is not a moving joint, for a position that is not finite, for one that
        makes a link pose overflow, and for positions at which a loop does not close.
        """
        # Unchecked: origins were checked on loading, and the motion of a joint is a rotation by
        # its formula, so that the product is one as well.
        matrices = self._tree.link_matrices(self._tree.complete_positions(positions))
        return LinkPoses(self.root_link, self._tree.link_rows, matrices)

    def complete_positions(self, positions: Mapping[str, float]) -> dict[str, float]:
        """Return the position of every moving joint, as `forward_kinematics` completes them."""
        return self._tree.complete_positions(positions)

    def jacobian(self, link: str, positions: Mapping[str, float]) -> tuple[Transform, FloatArray]:
        """Return ``root_from_link`` and the Jacobian (6, n) of the link's origin.

        Columns are the actuated joints in order. Rows are the velocity in mm and the angular
        velocity in rad, in the root's axes, per rad or m of the joint; mimic joints and closed
        loops follow. Raises `JointError` as `forward_kinematics`, and for an unknown link.
        """
        tree = self._tree
        if link not in tree.link_rows:
            tree.path_to(link)
        matrices = tree.link_matrices(tree.complete_positions(positions))
        jacobian = tree.jacobian(link, self.actuated_joint_names, matrices)
        return LinkPoses(self.root_link, tree.link_rows, matrices)[link], jacobian

    def measured_kinematics(self, link: str, positions: Mapping[str, float]) -> LinkPoses:
        """Run `forward_kinematics` with measured ``positions`` that must determine ``link``.

        Raises `JointError` also when a joint that moves ``link`` has no position, because the
        default of 0 would place the link where it is not.
        """
        self._tree.require_positions_for(link, positions)
        return self.forward_kinematics(positions)

    def is_determined(self, link: str, names: Set[str]) -> bool:
        """True if positions of the joints ``names`` are enough for `measured_kinematics`."""
        return self._tree.is_determined(link, names)

    def joints_that_move(self, link: str) -> frozenset[str]:
        """Names of the joints on which the pose of ``link`` depends, with mimic joints."""
        return self._tree.joints_that_move(link)

    def inverse_kinematics(
        self,
        link: str,
        root_from_link: Transform,
        *,
        seed: Mapping[str, float] | None = None,
        options: IkOptions | None = None,
    ) -> dict[str, float]:
        """Return positions (rad, m) of all actuated joints that move ``link`` to a pose.

        The positions are within the joint limits. The search starts at ``seed`` (by default the
        middle of the range), then from a fixed sequence of other starts (`IkOptions.restarts`).
        Joints that do not move ``link`` keep their seed, or 0. Raises `UnreachableError` with the
        smallest residual, `JointError` for unknown names and `FrameError` for other frames.
        """
        if (root_from_link.target, root_from_link.source) != (self.root_link, link):
            raise FrameError(
                f"the goal pose is {root_from_link.target}_from_{root_from_link.source}; "
                f"expected {self.root_link}_from_{link}"
            )
        return inverse_kinematics(
            self._tree, link, root_from_link, seed or {}, options or IkOptions()
        )
