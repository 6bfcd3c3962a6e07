"""A robot: links with their shapes, joints, and where the links are."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from app.geometry import FrameError, Transform
from app.robot.kinematics.inverse import IkOptions, inverse_kinematics
from app.robot.kinematics.joint import Joint
from app.robot.kinematics.link_poses import LinkPoses
from app.robot.kinematics.tree import KinematicTree
from app.robot.shapes import Link


@dataclass(frozen=True, slots=True, eq=False)
class Robot:
    """A tree of links. Made by `load_robot`, or from links and joints directly.

    ``warnings`` names what could not be shown (a missing display mesh), one sentence each.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    warnings: tuple[str, ...] = ()
    _tree: KinematicTree = field(init=False, repr=False)

    def __post_init__(self) -> None:
        tree = KinematicTree([link.name for link in self.links], self.joints)
        object.__setattr__(self, "_tree", tree)

    @property
    def root_link(self) -> str:
        """The link that no joint moves."""
        return self._tree.root

    @property
    def actuated_joint_names(self) -> tuple[str, ...]:
        """The joints that take a position: neither fixed nor following another; in file order."""
        return tuple(joint.name for joint in self.joints if joint.moves and joint.mimic is None)

    def forward_kinematics(self, positions: Mapping[str, float]) -> LinkPoses:
        """``root_from_link`` in mm for every link, at ``positions`` in rad (m for sliding joints).

        A joint that is not given is at 0, a mimic joint where its leader puts it unless it is
        given itself. Limits are not applied: a measured position is shown where it was measured.
        Raises `JointError` for a name that is no moving joint, for a position that is not finite
        and for one that puts a link beyond all numbers.
        """
        # Origins were checked when the robot was read, and a joint's motion is a rotation by its
        # formula: so is their product, which needs no checking at every step.
        matrices = self._tree.link_matrices(self._tree.all_positions(positions))
        return LinkPoses(self.root_link, self._tree.link_rows, matrices)

    def measured_kinematics(self, link: str, positions: Mapping[str, float]) -> LinkPoses:
        """As `forward_kinematics`, of measured ``positions``, for one who asks where ``link`` is.

        Raises `JointError` also for a joint that moves ``link`` and was not measured: a joint that
        is put at 0 would put the link at a place of nobody's choice.
        """
        self._tree.require_all_of(link, positions)
        return self.forward_kinematics(positions)

    def inverse_kinematics(
        self,
        link: str,
        root_from_link: Transform,
        *,
        seed: Mapping[str, float] | None = None,
        options: IkOptions | None = None,
    ) -> dict[str, float]:
        """Positions (rad, m) of all actuated joints that bring ``link`` to ``root_from_link``.

        Within the joint limits, starting at ``seed`` (middle of the range where it says nothing),
        then from a fixed sequence of other starts (`IkOptions.restarts`). Joints that do not move
        ``link`` keep their seed, or 0. Raises `UnreachableError` with the smallest residual, and
        `JointError` for names the robot does not have.
        """
        if (root_from_link.target, root_from_link.source) != (self.root_link, link):
            raise FrameError(
                f"the wanted pose is {root_from_link.target}_from_{root_from_link.source}: "
                f"{self.root_link}_from_{link} wanted"
            )
        return inverse_kinematics(
            self._tree, link, root_from_link, seed or {}, options or IkOptions()
        )
