"""Names of one of several robots on the ROS graph."""

from dataclasses import dataclass

from app.bridge.robots.errors import FollowError
from app.geometry import NS_PER_MS, FreshnessLimits, check_frame
from app.robot import Robot

DEFAULT_NODE = "robot_state_publisher"
DESCRIPTION = "robot_description"
JOINT_STATES = "joint_states"
STALE_AFTER_NS = 500 * NS_PER_MS
FUTURE_TOLERANCE_NS = 50 * NS_PER_MS
"""Largest lead of the stamp of a joint state or of tf over this node's clock: the clocks of two
hosts differ, and a simulated ``/clock`` comes 40 times a second from ``ros2 bag play``."""


def pose_limits(stale_after_ns: int) -> FreshnessLimits:
    """The limits of poses from joint states and tf; no stamp may be further ahead than behind."""
    return FreshnessLimits(
        stale_after_ns, future_tolerance_ns=min(FUTURE_TOLERANCE_NS, stale_after_ns)
    )


@dataclass(frozen=True, slots=True)
class RobotSettings:
    """ROS names of a robot's description and state.

    ``namespace`` prefixes the names of its topics and nodes. ``tf_prefix`` prefixes the names of
    its links in tf; a ``/`` between them is added if missing. ``fixed_frame`` is the unprefixed tf
    frame of its poses; if empty it is the prefixed root link. A state older than
    ``stale_after_ns`` is stale. Raises `FollowError` for an empty name and a limit that is not
    positive.
    """

    name: str
    namespace: str = ""
    tf_prefix: str = ""
    fixed_frame: str = ""
    stale_after_ns: int = STALE_AFTER_NS

    def __post_init__(self) -> None:
        if not self.name.strip():
            raise FollowError(f"robot name is {self.name!r}; expected a name that is not blank")
        for text in (self.namespace.strip("/"), self.tf_prefix.rstrip("/"), self.fixed_frame):
            if text:
                check_frame(text)
        if self.stale_after_ns <= 0:
            raise FollowError(
                f"stale_after_ns of robot {self.name!r} is {self.stale_after_ns}; "
                "expected more than 0"
            )

    @property
    def freshness_limits(self) -> FreshnessLimits:
        """When the state is too old, and how far its stamp may be ahead."""
        return pose_limits(self.stale_after_ns)

    def topic(self, name: str) -> str:
        """Absolute name of a topic or node of this robot; one with a leading ``/`` is unchanged."""
        if name.startswith("/"):
            return name
        namespace = self.namespace.strip("/")
        return f"/{namespace}/{name}" if namespace else f"/{name}"

    def frame(self, link: str) -> str:
        """Name of the tf frame of a link."""
        prefix = self.tf_prefix.rstrip("/")
        return f"{prefix}/{link}" if prefix else link

    def root_frame(self, robot: Robot) -> str:
        """Frame of the poses: ``fixed_frame`` if set, otherwise that of the root link."""
        return self.fixed_frame or self.frame(robot.root_link)
