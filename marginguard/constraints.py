"""Constraints: limit a twist, and read what a session publishes on ROS."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from app.fixture import (
    Constraint,
    FixtureRule,
    JointLimits,
    LimiterParameters,
    PlainConstraint,
    RulePermission,
    limit_twist,
)
from app.geometry import InputError
from app.runtime import ReceivedConstraint
from marginguard.values import needs

if TYPE_CHECKING:
    from marginguard_msgs.msg import FixtureConstraint

    from app.bridge.constraint_message import ConstraintReader

__all__ = [
    "Constraint",
    "FixtureRule",
    "JointLimits",
    "LimiterParameters",
    "PlainConstraint",
    "ReceivedConstraint",
    "RulePermission",
    "constraint_stream",
    "limit_twist",
    "other_definitions",
    "plain_constraint",
    "prepare_ros",
    "read_constraint",
]

DEFAULT_TOPIC = "/marginguard/constraint"


def read_constraint(topic: str = DEFAULT_TOPIC, *, timeout_s: float = 5.0) -> ReceivedConstraint:
    """Wait for one constraint of a running session and return it, in mm.

    Joins the ROS graph and leaves it again, which takes about a second: use `constraint_stream` for
    more than one. Stays on this machine unless ``ROS_AUTOMATIC_DISCOVERY_RANGE`` is set. Needs the
    extra ``ros``. Raises `InputError` without it, `BridgeError` (a `MarginGuardError`) if none
    arrives in ``timeout_s`` and for a topic that cannot be used.

    >>> import marginguard as mg
    >>> mg.read_constraint("/no/such/session", timeout_s=0.1)
    Traceback (most recent call last):
        ...
    app.bridge.ros_errors.BridgeError: /no/such/session: no constraint in 0.1 s; it has ...
    """
    with constraint_stream(topic, timeout_s=timeout_s) as constraints:
        return constraints.read()


@contextmanager
def constraint_stream(
    topic: str = DEFAULT_TOPIC, *, timeout_s: float = 5.0
) -> "Iterator[ConstraintReader]":
    """Subscribe to the constraints of a session while the ``with`` block runs.

    ``for received in constraints`` yields each new one, ``constraints.read()`` the newest that has
    not been read. Both raise as `read_constraint` when none arrives in ``timeout_s``. A slow reader
    misses constraints; it never gets an old one.

    >>> import marginguard as mg
    >>> with mg.constraint_stream("/no/such/session") as constraints:
    ...     constraints.read(timeout_s=0.1)
    Traceback (most recent call last):
        ...
    app.bridge.ros_errors.BridgeError: /no/such/session: no constraint in 0.1 s; it has ...
    """
    if not isinstance(topic, str):
        raise InputError(f"topic: is {topic!r}; expected the name of a topic as str")
    with needs("ROS 2"):
        from app.bridge.constraint_message import ConstraintReader
    prepare_ros()
    with ConstraintReader(topic, timeout_s=timeout_s) as reader:
        yield reader


def prepare_ros() -> str:
    """Keep ROS nodes of this process on this machine, as MarginGuard's commands do.

    Call it before ``rclpy.init()``; without it the whole network sees a node of your own, which is
    ROS's default. A range that ``ROS_AUTOMATIC_DISCOVERY_RANGE`` sets is kept. Returns one line
    that says which range holds. Needs the extra ``ros``. Raises `InputError` without it.

    >>> import marginguard as mg
    >>> mg.prepare_ros().startswith("ROS discovery")
    True
    """
    with needs("ROS 2"):
        from app.bridge import prepare_environment
    return prepare_environment()


def plain_constraint(message: "FixtureConstraint") -> PlainConstraint:
    """The values of a received message that `FixtureRule` needs, in mm; nothing is checked.

    For a controller with a node of its own (``docs/controller.md``). Needs the extra ``ros``.
    Raises `InputError` without it.

    >>> import marginguard as mg
    >>> from marginguard_msgs.msg import FixtureConstraint, HalfSpace
    >>> floor = HalfSpace(offset=0.005)  # 5 mm above the origin
    >>> floor.normal.z, floor.point_on_tool.z = 1.0, 0.008
    >>> message = FixtureConstraint(instance_id="a", setup_id="b", seq=1, half_spaces=[floor])
    >>> message.planes_current = True  # and not message.simulated
    >>> message.max_tool_speed, message.max_tool_turn = 0.05, 0.5  # m/s, rad/s
    >>> message.free_distance, message.free_turn = 0.02, 0.2  # m, rad
    >>> message.header.frame_id, message.valid_until.nanosec = "tumor", 60_000_000
    >>> plain = mg.plain_constraint(message)
    >>> isinstance(plain, mg.PlainConstraint), plain.offsets_mm.tolist()
    (True, [5.0])
    >>> rule = mg.FixtureRule(frame="tumor")
    >>> rule.receive(plain, now_ns=1_000_000)
    >>> down = [0.0, 0.0, -100.0, 0.0, 0.0, 0.0]  # mm/s, rad/s; 3 mm are left
    >>> decision = rule.allow(down, [0.0, 0.0, 8.0], now_ns=2_000_000)
    >>> decision.permission is mg.RulePermission.WITHIN_PLANES, decision.twist[2].round(3).item()
    (True, -50.0)
    >>> rule.allow(down, [0.0, 0.0, 8.0], now_ns=70_000_000).permission.name  # not valid any more
    'NO_MOTION'
    """
    with needs("ROS 2"):
        from app.bridge.constraint_message import plain_constraint as convert
    return convert(message)


def other_definitions(node: Any, topic: str = DEFAULT_TOPIC) -> dict[str, str]:
    """Publishers of ``topic`` whose ``FixtureConstraint`` has another definition than ours.

    Those that the rclpy ``node`` knows: type hash by the name of their node. While there is one,
    use no constraint: ROS connects the two and decodes wrong values without an error. A publisher
    that announces no hash is not listed. ``docs/controller.md`` says when to ask. Needs the extra
    ``ros``. Raises `InputError` without it, `BridgeError` if other messages are installed than
    those of this version.

    >>> import rclpy
    >>> import marginguard as mg
    >>> where = mg.prepare_ros()
    >>> rclpy.init()
    >>> mg.other_definitions(rclpy.create_node("controller"))
    {}
    >>> rclpy.shutdown()
    """
    with needs("ROS 2"):
        from marginguard_msgs.msg import FixtureConstraint

        from app.bridge.message_definitions import check_installed, foreign_endpoints
    check_installed()
    return foreign_endpoints(node.get_publishers_info_by_topic(topic), FixtureConstraint)
