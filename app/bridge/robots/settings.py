"""How one robot among several is named on the ROS graph."""

from dataclasses import dataclass

from app.bridge.robots.errors import FollowError
from app.geometry import NS_PER_MS, FreshnessLimits, check_frame
from app.robot import Robot

DEFAULT_NODE = "robot_state_publisher"
DESCRIPTION = "robot_description"
JOINT_STATES = "joint_states"
STALE_AFTER_NS = 500 * NS_PER_MS
FUTURE_TOLERANCE_NS = 50 * NS_PER_MS
"""How far the stamp of a joint state or of tf may be ahead of this node's clock: the clocks of two
hosts differ, and a simulated ``/clock`` comes 40 times a second from ``ros2 bag play``."""


def pose_limits(stale_after_ns: int) -> FreshnessLimits:
    """The limits of poses from joint states and tf; no stamp may be further ahead than behind."""
    return FreshnessLimits(
        stale_after_ns, future_tolerance_ns=min(FUTURE_TOLERANCE_NS, stale_after_ns)
    )


@dataclass(frozen=True, slots=True)
class RobotSettings:
    """Where a robot's description and state are, in ROS names.

    ``namespace`` stands before the names of its topics and of its nodes; ``tf_prefix`` before the
    names of its links in tf, with a ``/`` between, whether it was given or not. ``fixed_frame`` is
    the tf frame that its poses are in, as it stands; empty: the (prefixed) root of the robot. A
    state older than ``stale_after_ns`` is stale.
    """

    name: str
    namespace: str = ""
    tf_prefix: str = ""
    fixed_frame: str = ""
    stale_after_ns: int = STALE_AFTER_NS

    def __post_init__(self) -> None:
        if not self.name.strip():
            raise FollowError("a robot's name is empty")
        for text in (self.namespace.strip("/"), self.tf_prefix.rstrip("/"), self.fixed_frame):
            if text:
                check_frame(text)
        if self.stale_after_ns <= 0:
            raise FollowError(
                f"robot {self.name!r} is stale after {self.stale_after_ns} ns: more than 0 wanted"
            )

    @property
    def freshness_limits(self) -> FreshnessLimits:
        """When the state is too old, and how far its stamp may be ahead."""
        return pose_limits(self.stale_after_ns)

    def topic(self, name: str) -> str:
        """The absolute name of a topic or node of this robot; one with a ``/`` in front stays."""
        if name.startswith("/"):
            return name
        namespace = self.namespace.strip("/")
        return f"/{namespace}/{name}" if namespace else f"/{name}"

    def frame(self, link: str) -> str:
        """The tf frame of a link."""
        prefix = self.tf_prefix.rstrip("/")
        return f"{prefix}/{link}" if prefix else link

    def root_frame(self, robot: Robot) -> str:
        """The frame that poses are in: the fixed one, else the root link's."""
        return self.fixed_frame or self.frame(robot.root_link)
