"""Velocity commands of another process limited by the constraint.

The tool's tip is at the tumour's origin. The constraint has one plane with normal +z, 5 mm away.
"""

import math
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import TwistStamped
from rclpy.serialization import deserialize_message

from app.bridge import topics
from app.bridge.control import allowed_twist
from app.bridge.control.allowed_twist import TwistLimiter
from app.bridge.heartbeat import steady_ns
from app.bridge.tf import TransformBuffer
from app.fixture import FreeMotion, LimiterParameters, MarginState, Reason
from app.geometry import NS_PER_S, Stamp, TrackedTransform, Transform
from app.session import KnownEdges, Session, SessionSetup
from tests.bridge.conftest import DEADLINE_S, START_NS
from tests.doubles import PARAMETERS, AnalyticSphere, frame, sample
from tests.waiting import wait_until

pytestmark = pytest.mark.slow

SENDER = Path(__file__).resolve().parent / "twist_sender.py"
LONG_NS = 10**11
TIMEOUT_NS = 10**11
"""Longer than a busy machine delays a command."""

MAX_APPROACH_M_S = 0.005 / 0.05
"""The clearance divided by the time constant, if the tool has not moved since."""


def margins(stale_after_ns):
    """Test double of margins, whose ``stale_after_ns`` may be longer than real ones allow."""
    return SimpleNamespace(stale_after_ns=stale_after_ns, v_max_mm_s=250.0)


LONG = margins(LONG_NS)


def command(*linear, frame="tumor", late_s=0.0, angular=(0.0, 0.0, 0.0)):
    return {"frame": frame, "late_s": late_s, "linear": linear, "angular": list(angular)}


@pytest.fixture
def buffer():
    """Buffer with ``rotated``, whose x is the tumour's +z, and the outdated frame ``old``."""
    known = TransformBuffer()
    half = math.sqrt(0.5)
    known.insert("tumor", "rotated", 0, (0.0, 0.0, 0.0, 0.0, -half, 0.0, half), static=True)
    known.insert("tumor", "old", 1, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    return known


@pytest.fixture
def limiter(ros, buffer):
    return TwistLimiter(ros, buffer, timeout_ns=TIMEOUT_NS)


@pytest.fixture
def replies(ros, start):
    """``replies(command(...), ...)``: another process sends commands and returns the replies."""
    found = []

    def send(*commands):
        if not found:
            found.append(start(SENDER))
            found[0].line()
            # It has found the limiter; the limiter must have found it, or the first reply is lost.
            assert ros.wait_for_subscribers(topics.ALLOWED_TWIST, 1, DEADLINE_S)
        return [found[0].ask(each) for each in commands]

    return send


def is_zero(reply):
    return reply["linear"] == [0.0] * 3 and reply["angular"] == [0.0] * 3


def test_only_the_approach_is_limited_in_every_frame(limiter, make_step, replies):
    step = make_step(0)
    still = np.zeros((1, 3))
    constraint = replace(step.decision.constraint, tumor_velocities_mm_s=still)
    limiter.allow(replace(step, decision=step.decision._replace(constraint=constraint)), LONG)
    found = replies(
        command(0.01, 0.02, 0.03),
        command(0.01, 0.0, -0.00004),
        command(0.01, 0.02, -1.0),
        command(-1.0, 0.02, 0.01, frame="rotated"),
    )
    assert found[0]["linear"] == pytest.approx([0.01, 0.02, 0.03])
    # The plane limits the velocity of the point (1, 2, 17.5) mm, which includes the rotation.
    point_m = np.array([0.001, 0.002, 0.0175])
    approaches = [MAX_APPROACH_M_S]
    for reply, tumor_from_frame in ((found[2], np.eye(3)), (found[3], rotated_axes())):
        linear = tumor_from_frame @ np.array(reply["linear"])
        angular = tumor_from_frame @ np.array(reply["angular"])
        approaches.append(-(linear + np.cross(angular, point_m))[2])
    assert approaches[1] == pytest.approx(MAX_APPROACH_M_S, rel=0.05)
    # The tool has followed that reply meanwhile, and is nearer.
    assert 0.0 <= approaches[2] < approaches[1]
    assert found[3]["frame"] == "rotated"
    assert found[1]["linear"] == pytest.approx([0.01, 0.0, -0.00004])
    assert limiter.refused.total() == 0


def rotated_axes():
    """Axes of ``rotated`` in the tumour's frame, as columns."""
    return np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])


def test_invalid_commands_give_no_motion(limiter, make_step, replies):
    limiter.allow(make_step(0), margins(LONG_NS // 10**6))
    fresh = replace(make_step(0))
    limiter.allow(fresh, LONG)
    found = replies(
        command(0.0, 0.0, math.nan),
        command(0.0, math.inf, 0.01),
        command(0.0, 0.0, 0.01, angular=(math.nan, 0.0, 0.0)),
        command(0.0, 0.0, 0.01, late_s=600.0),
        command(0.0, 0.0, 0.01, late_s=-60.0),
        command(0.0, 0.0, 0.01, frame="nowhere"),
        command(0.0, 0.0, 0.01, frame=""),
        command(0.0, 0.0, 1e306),
    )
    assert [is_zero(reply) for reply in found] == [True] * 8
    assert limiter.refused["a command is not finite"] == 4
    assert limiter.refused["a command is too old"] == 1
    assert limiter.refused["a command is from the future"] == 1
    assert limiter.refused["frame of a command"] == 2


def test_stale_frame_gives_no_motion(limiter, make_step, replies):
    limiter.allow(make_step(0), margins(10**15))
    found = replies(command(0.0, 0.0, 0.01, frame="old"))
    assert is_zero(found[0])


@pytest.mark.parametrize(
    ("stale_after_ns", "spent_ns"),
    [(3_000_000, 0), (LONG_NS, LONG_NS - 3_000_000)],
    ids=["old samples", "long computation"],
)
def test_stale_constraint_gives_no_motion(limiter, make_step, replies, stale_after_ns, spent_ns):
    limiter.allow(make_step(0), margins(stale_after_ns), spent_ns)
    found = replies(command(0.0, 0.0, -0.01), command(0.01, 0.0, 0.02))
    assert [is_zero(reply) for reply in found] == [True] * 2
    assert limiter.refused["the constraint is stale"] == 2


def faulty(step, **changes):
    """Copy of ``step`` with a fault and its constraint on hold."""
    decision = step.decision
    changes = {"constraint": decision.constraint.on_hold(), **changes}
    unknown = decision._replace(
        state=MarginState.UNKNOWN, reasons=(Reason.FROZEN,), hold=True, **changes
    )
    return replace(step, decision=unknown)


def earlier_planes(step):
    """Copy of ``step`` whose planes belong to an earlier pose of the tool."""
    return faulty(step, constraint_is_current=False)


def of_the_future(step):
    return faulty(step, stamp=Stamp(step.frame.stamp.ns + 1))


@pytest.mark.parametrize(
    "invalidate",
    [
        earlier_planes,
        of_the_future,
        lambda step: faulty(step, stamp=None),
        lambda step: faulty(step, constraint=None, constraint_is_current=False),
        lambda step: replace(step, tumor_from_tip=None),
    ],
)
def test_planes_of_another_pose_give_no_motion(limiter, make_step, replies, invalidate):
    limiter.allow(make_step(0), LONG)
    limiter.allow(invalidate(make_step(0)), LONG)
    found = replies(command(0.0, 0.0, -0.01), command(0.0, 0.0, 0.01))
    assert [is_zero(reply) for reply in found] == [True] * 2
    assert limiter.refused["no constraint of now is known"] == 2


def test_hold_allows_retreat_and_no_approach(limiter, make_step, replies):
    limiter.allow(faulty(make_step(0)), LONG)
    found = replies(command(0.0, 0.0, -0.01), command(0.01, 0.0, 0.02))
    point_m = np.array([0.001, 0.002, 0.0175])
    linear, angular = np.array(found[0]["linear"]), np.array(found[0]["angular"])
    assert (linear + np.cross(angular, point_m))[2] >= -1e-9
    assert found[1]["linear"] == pytest.approx([0.01, 0.0, 0.02])


def test_tool_beyond_the_tumor_can_leave_and_not_reenter(limiter, replies):
    tip_mm = {"tracker": (-12.0, 0.0, 0.5), "beyond": (10.5, 0.0, 0.5)}
    setup = SessionSetup(
        Transform.identity("cautery", "cautery_tip"),
        Transform.identity("needle", "tumor"),
        AnalyticSphere(10.0),
        PARAMETERS,
        None,
    )
    session = Session(setup)
    for at_ms, where in ((0, "tracker"), (20, "beyond")):
        needle = sample("tracker", "needle", (0.0, 0.0, 0.001 * at_ms), at_ms)
        cautery = sample("tracker", "cautery", tip_mm[where], at_ms)
        step = session.step(frame(at_ms, needle, cautery))
    # The state is that of the path through the tumour; the planes are those of the current pose.
    assert step.decision.state is MarginState.POSITIVE
    assert abs(step.decision.proximity.on_tool_mm[0]) < 1.0  # the deepest pose of the path
    free = replace(step.decision.constraint, free=FreeMotion(20.0, 0.1))
    limiter.allow(replace(step, decision=step.decision._replace(constraint=free)), LONG)
    found = replies(command(0.02, 0.0, 0.0), command(-0.01, 0.0, 0.0))
    out, back_in = found[0]["linear"], found[1]["linear"]
    # The tool is 0.51 mm away, 0.49 mm within the stop margin.
    assert out == pytest.approx([0.02, 0.0, 0.0])
    normal = step.decision.constraint.normals[0]
    assert normal @ back_in == pytest.approx(0.00049 / 0.05, rel=0.05)


def robot_step(make_step):
    """A step whose session knows ``reference`` in the tracker and a registered base."""
    stamp = make_step(0).decision.stamp
    half = math.sqrt(0.5)

    def turned(target, source, z):
        turn = (0.0, 0.0, 2.0 * math.atan2(z, half))
        return Transform.from_rotation_vector(turn, (1, 2, 3), target=target, source=source)

    measured = {
        ("tracker", "needle"): TrackedTransform.valid(turned("tracker", "needle", half), stamp),
        ("tracker", "reference"): TrackedTransform.valid(
            turned("tracker", "reference", -half), stamp
        ),
        ("tracker", "lost"): None,
    }
    static = (
        Transform.identity("needle", "tumor"),
        Transform.identity("cautery", "cautery_tip"),
        turned("reference", "robot_base", 0.1),
    )
    return replace(
        make_step(0), edges=KnownEdges(static, measured, base="robot_base", root="robot_base")
    )


@pytest.mark.parametrize("frame", ["robot_base", "hand"])
def test_foreign_edges_do_not_turn_frames_that_the_session_knows(
    limiter, buffer, make_step, replies, frame
):
    """``hand`` hangs on ``robot_base`` and has its axes; others turn every edge above it."""
    around = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    for parent, child in (("reference", "robot_base"), ("tumor", "reference")):
        buffer.insert(parent, child, 0, around, static=True)
    buffer.insert("robot_base", "hand", 0, (0.0,) * 6 + (1.0,), static=True)
    step = robot_step(make_step)
    base, _ = step.edges.between("tumor", "robot_base")
    limiter.allow(faulty(step), LONG)
    retreat, approach = base.rotation.T @ [0.0, 0.0, 0.03], base.rotation.T @ [0.0, 0.0, -0.03]
    found = replies(command(*retreat, frame=frame), command(*approach, frame=frame))
    assert found[0]["linear"] == pytest.approx(retreat)
    point_m = np.array([0.001, 0.002, 0.0175])
    linear = base.rotation @ np.array(found[1]["linear"])
    angular = base.rotation @ np.array(found[1]["angular"])
    assert (linear + np.cross(angular, point_m))[2] >= -1e-9


def test_frame_between_two_known_ones_and_lost_frames_give_no_motion(
    limiter, buffer, make_step, replies
):
    straight = (0.0,) * 6 + (1.0,)
    buffer.insert("world", "tracker", 0, straight, static=True)
    buffer.insert("world", "robot_base", 0, straight, static=True)
    buffer.insert("world", "lost", 0, straight, static=True)
    buffer.insert("tumor", "far", 0, straight, static=True)
    limiter.allow(robot_step(make_step), LONG)
    found = replies(
        *(command(0.0, 0.0, 0.01, frame=name) for name in ("world", "lost", "far", "reference"))
    )
    assert [is_zero(reply) for reply in found[:4]] == [True, True, False, False]
    assert limiter.refused["frame of a command"] == 2


def test_old_pose_on_the_way_to_a_frame_gives_no_motion(limiter, make_step, replies):
    step = robot_step(make_step)
    old = Stamp(step.decision.stamp.ns - LONG_NS)
    edge = ("tracker", "reference")
    sample_of_old = TrackedTransform.valid(step.edges.measured[edge].transform, old)
    edges = step.edges._replace(measured={**step.edges.measured, edge: sample_of_old})
    limiter.allow(replace(step, edges=edges), LONG)
    found = replies(
        command(0.0, 0.0, 0.01, frame="robot_base"), command(0.0, 0.0, 0.01, frame="needle")
    )
    assert [is_zero(reply) for reply in found[:2]] == [True, False]
    assert limiter.refused["the constraint is stale"] == 1


@pytest.mark.parametrize("stop", ["before the reply", "while it is sent"])
def test_stop_of_the_process_while_a_twist_is_computed_gives_no_motion(
    limiter, make_step, replies, monkeypatch, stop
):
    """The clock goes on by the validity during the computation, or while the reply is sent."""
    ahead_ns = [0]
    monkeypatch.setattr(
        "app.bridge.control.allowed_twist.steady_ns", lambda: steady_ns() + ahead_ns[0]
    )
    limiter.allow(make_step(0), LONG)
    first = "limit_twist" if stop == "before the reply" else "serialize_message"
    compute = getattr(allowed_twist, first)
    publish = limiter._publisher.publish

    def delayed(*arguments):
        result = compute(*arguments)
        if stop == "before the reply":
            ahead_ns[0] = LONG_NS
        return result

    def sent(raw):
        publish(raw)
        ahead_ns[0] = LONG_NS

    monkeypatch.setattr(allowed_twist, first, delayed)
    if stop == "while it is sent":
        monkeypatch.setattr(limiter._publisher, "publish", sent, raising=False)
    found = replies(command(0.0, 0.0, 0.01))
    if stop == "before the reply":
        assert is_zero(found[0])
        assert limiter.refused["the constraint is stale"] == 1
    else:  # what has been sent cannot be taken back: a zero twist follows at once
        (after,) = replies(None)
        assert is_zero(after)


def test_revoked_allowance_is_not_used_by_a_twist_that_is_being_computed(
    limiter, make_step, replies, monkeypatch
):
    limiter.allow(make_step(0), LONG)
    compute = allowed_twist.limit_twist

    def revoked(*arguments):
        limiter.forbid()
        return compute(*arguments)

    monkeypatch.setattr(allowed_twist, "limit_twist", revoked)
    found = replies(command(0.0, 0.0, 0.01))
    assert is_zero(found[0])
    assert limiter.refused["no constraint of now is known"] == 1


def test_transform_from_the_future_does_not_rotate_a_command(limiter, buffer, make_step, replies):
    oldest_ns = START_NS - 3_000_000
    straight, half = (0.0,) * 6 + (1.0,), math.sqrt(0.5)
    around = (0.0, 0.0, 0.0, half, 0.0, 0.0, half)
    for name, ahead_ns in (("far", 900_000_000), ("near", 40_000_000)):
        buffer.insert("tumor", name, oldest_ns, straight)
        buffer.insert("tumor", name, oldest_ns + ahead_ns, around)
    step, stale_after_ns = make_step(0), 60_000_000_000
    limiter.allow(step, margins(stale_after_ns))
    commands = (command(0.0, 0.02, 0.01, frame=name) for name in ("far", "near"))
    for reply in replies(*commands):
        assert reply["linear"] == pytest.approx([0.0, 0.02, 0.01])
    buffer.insert("tumor", "later", oldest_ns + stale_after_ns + 1, around)
    (later,) = replies(command(0.0, 0.0, 0.01, frame="later"))
    assert is_zero(later)
    assert limiter.refused["way to the frame of a command"] == 1


def test_long_frame_names_are_neither_stored_nor_logged(limiter, make_step, replies, capfd):
    limiter.allow(make_step(0), LONG)
    names = [letter * length for length in (100_000, 257, 256) for letter in "abcd"]
    found = replies(*(command(0.0, 0.0, 0.01, frame=name) for name in names))
    assert all(is_zero(reply) for reply in found)
    assert [reply["frame"] for reply in found[:12]] == [""] * 8 + names[8:]
    assert limiter.refused["frame of a command"] == 12
    assert len(capfd.readouterr().err) < 5_000


def test_reply_is_limited_to_the_maximum_speed(ros, buffer, make_step, replies):
    limits = LimiterParameters(max_speed_mm_s=100.0, max_turn_rad_s=0.5)
    limiter = TwistLimiter(ros, buffer, parameters=limits, timeout_ns=TIMEOUT_NS)
    limiter.allow(make_step(0), LONG)
    found = replies(command(0.0, 0.0, 1e9), command(0.0, 0.0, 0.01, angular=(0.0, 0.0, 1.0)))
    assert found[0]["linear"] == pytest.approx([0.0, 0.0, 0.1])
    assert found[1]["linear"] == pytest.approx([0.0, 0.0, 0.005])
    assert found[1]["angular"] == pytest.approx([0.0, 0.0, 0.5])


def test_timeout_stops_motion_while_the_nodes_thread_is_blocked(ros, buffer, make_step, replies):
    limiter = TwistLimiter(ros, buffer, timeout_ns=10**8)
    limiter.allow(make_step(0), LONG)
    _, zero = replies(command(0.0, 0.0, 0.01), None)
    assert is_zero(zero)
    blocked, release = threading.Event(), threading.Event()

    def block():
        blocked.set()
        release.wait(DEADLINE_S)

    ros.call_soon(block)
    assert blocked.wait(DEADLINE_S)
    before = limiter.refused["no command comes any more"]
    wait_until(lambda: limiter.refused["no command comes any more"] >= before + 2)
    release.set()


class SlowPublisher:
    """Test double of a publisher that returns 30 ms after it has sent a motion."""

    def __init__(self, publisher):
        self._publisher = publisher

    def publish(self, raw):
        self._publisher.publish(raw)
        if deserialize_message(raw, TwistStamped).twist.linear.z != 0.0:
            threading.Event().wait(0.03)


def test_motion_counts_from_before_it_is_sent(ros, buffer, make_step, replies, monkeypatch):
    create = ros.publisher
    monkeypatch.setattr(ros, "publisher", lambda topic: SlowPublisher(create(topic)))
    limiter = TwistLimiter(ros, buffer, timeout_ns=TIMEOUT_NS)
    limiter.allow(make_step(0), LONG)
    first, second = (-each["linear"][2] for each in replies(*[command(0.0, 0.0, -1.0)] * 2))
    # The tool was still at first, so the clearance is that times tau; 30 ms of 50 are used.
    assert first == pytest.approx(MAX_APPROACH_M_S, rel=0.05)
    assert second <= 0.4 * first + 1e-6


def test_motion_ends_when_its_data_are_too_old(limiter, make_step, replies):
    limiter.allow(make_step(0), margins(NS_PER_S))
    moving, zero = replies(command(0.01, 0.0, 0.0), None)
    assert moving["linear"][0] == pytest.approx(0.01)
    assert is_zero(zero)
    assert limiter.refused["the constraint is stale"] == 1


def test_motion_ends_after_the_time_constant_by_default(ros, buffer, make_step, replies):
    limiter = TwistLimiter(ros, buffer)
    limiter.allow(make_step(0), LONG)
    _, zero = replies(command(0.01, 0.0, 0.0), None)
    assert is_zero(zero)
    assert limiter.refused["no command comes any more"] >= 1


def test_no_motion_follows_recorded_or_simulated_poses(ros, buffer, make_step, replies):
    limiter = TwistLimiter(ros, buffer, timeout_ns=TIMEOUT_NS, simulated=True)
    limiter.allow(make_step(0), LONG)
    found = replies(command(0.0, 0.0, 0.01), command(0.0, 0.0, -0.01))
    assert all(map(is_zero, found))
    assert limiter.refused["the poses are recorded or simulated"] == 2


def test_no_motion_before_the_first_step(limiter, replies):
    found = replies(command(0.0, 0.0, 0.01))
    assert is_zero(found[0])
    assert limiter.refused["no constraint of now is known"] == 1
