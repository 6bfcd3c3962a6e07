"""The controller's node against publishers of another node; the test decides when it steps."""

import json
import time
from dataclasses import replace
from functools import partial

import jsonschema
import numpy as np
import pytest
import yaml
from geometry_msgs.msg import Vector3, WrenchStamped
from marginguard_msgs.msg import FixtureConstraint, HalfSpace, TrackedTransform
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from app.bridge import RosNode
from app.bridge.arm_control import ControlNode
from app.bridge.arm_inputs import ConstraintInput
from app.bridge.constraint_message import plain_constraint
from app.bridge.messages import ns_of
from app.bridge.topics import NEWEST, STREAM, Topic
from app.cli.main import main
from app.control import CONTROL, open_control
from app.files import schema_text
from app.fixture import PlainConstraint
from app.geometry import NS_PER_MS, NS_PER_S, InputError
from tests.bridge.nodes import ros_nodes
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.slow

STEPS = 4000
FAR_M = 10.0
VALID_NS = NS_PER_S
JOINTS = ["waist", "shoulder", "elbow", "yaw", "pitch", "roll"]
POSITIONS = [0.0, 1.0, 0.5, 0.0, 0.1, 0.0]

MEASURED = Topic("/arm/measured_js", JointState, STREAM)
WRENCH = Topic("/arm/body/measured_cf", WrenchStamped, STREAM)
TRACKED = Topic("/tracked_transforms", TrackedTransform, STREAM)
CONSTRAINT = Topic("/marginguard/constraint", FixtureConstraint, NEWEST)
SENT = (MEASURED, WRENCH, TRACKED, CONSTRAINT)


class Peer:
    """A node that sends all that the controller reads, and reads what it sends."""

    def __init__(self, ros, joints, clock_ns):
        self.ros, self.joints, self.positions, self._clock_ns = ros, joints, POSITIONS, clock_ns
        self.commands = []
        self._measured, self._wrench, self._tracked, self._constraint = map(ros.publisher, SENT)
        ros.subscribe(Topic("/arm/servo_jv", JointState, STREAM), self.commands.append)
        self.seq = 0
        self.instance = "guard"
        self.setup = "setup"
        self.tumor_turn = [0.0, 0.0, 0.0, 1.0]
        """Quaternion of the tumour in its tracked frame."""
        self.base = ""
        self.point_mm = np.zeros(3)
        """Point of the tool that the plane holds for, in the tumour's frame."""

    def send(self, *, constraint=True, tumor=True, force=(0.0, 0.0, 5.0), plane=-FAR_M):
        """Send one message of each kind with the present stamp; force in N, plane in m."""
        now_ns = self._clock_ns()
        joints = JointState(name=self.joints, position=self.positions)
        stamp(joints.header, now_ns)
        self._measured.publish(joints)
        wrench = WrenchStamped()
        stamp(wrench.header, now_ns)
        wrench.wrench.force = Vector3(x=force[0], y=force[1], z=force[2])
        self._wrench.publish(wrench)
        pose = TrackedTransform(child_frame_id="tumor_sensor")
        stamp(pose.header, now_ns)
        pose.header.frame_id = "tracker"
        pose.transform.rotation.w = 1.0
        pose.status = 0 if tumor else 2
        self._tracked.publish(pose)
        if constraint:
            self.seq += 1
            message = FixtureConstraint(seq=self.seq, instance_id=self.instance, simulated=True)
            message.header.frame_id = "tumor"
            stamp(message.header, now_ns)
            message.valid_until.sec, message.valid_until.nanosec = divmod(
                now_ns + VALID_NS, NS_PER_S
            )
            message.planes_current = True
            message.free_distance, message.free_turn = 1.0, 1.0
            message.max_tool_speed, message.max_tool_turn = 0.25, 2.0
            message.setup_id = self.setup
            turn = message.tumor.transform.rotation
            turn.x, turn.y, turn.z, turn.w = self.tumor_turn
            if self.base:
                message.base.header.frame_id, message.base.child_frame_id = "tracker", "base"
            message.tumor.header.frame_id, message.tumor.child_frame_id = "tumor_sensor", "tumor"
            half_space = HalfSpace(offset=plane)
            half_space.normal.z = 1.0
            point = half_space.point_on_tool
            point.x, point.y, point.z = (self.point_mm / 1000.0).tolist()
            message.half_spaces = [half_space]
            self._constraint.publish(message)


def stamp(header, ns):
    header.stamp.sec, header.stamp.nanosec = divmod(ns, NS_PER_S)


class Controlled:
    """A controller, its peer, and steps of both in turn: 1 ms each by a clock of their own.

    A step waits for what was sent, so that a busy machine makes nothing late.
    """

    def __init__(self, ros, peer_ros, description):
        self._now_ns = time.time_ns()
        self.peer = Peer(peer_ros, JOINTS, self.clock_ns)
        self.node = ControlNode(ros, description, clock_ns=self.clock_ns)
        self._arrived_ns = {}
        for topic in SENT:
            ros.subscribe(topic, partial(self._note, topic))

    def clock_ns(self):
        return self._now_ns

    def _note(self, topic, message):
        self._arrived_ns[topic] = ns_of(message.header.stamp)

    def step(self, **sent):
        self._now_ns += NS_PER_MS
        self.peer.send(**sent)
        expected = [each for each in SENT if each is not CONSTRAINT or sent.get("constraint", True)]
        wait_until(
            lambda: all(self._arrived_ns.get(topic) == self._now_ns for topic in expected),
            meanwhile=partial(self.peer.send, **sent),  # what comes before the discovery is lost
            pause_s=0.001,
        )
        return self.node.step()

    def until(self, condition, **sent):
        for _ in range(STEPS):
            decision = self.step(**sent)
            if condition(decision):
                return decision
        pytest.fail(f"not within {STEPS} steps: {decision.reason} {decision.rule}")

    def rearm(self, **sent):
        client = self.peer.ros.node.create_client(Trigger, "/marginguard_control/rearm")
        assert client.wait_for_service(10.0)
        reply = client.call_async(Trigger.Request())
        self.until(lambda _: reply.done(), **sent)
        return reply.result()


@pytest.fixture
def controlled(domain_id, project_root):
    description = open_control(project_root / "data" / "worlds" / "lumpectomy")
    with ros_nodes(domain_id, "marginguard_control", "peer") as (ros, peer):
        yield Controlled(ros, peer, description)


def test_arm_follows_the_hand_and_stands_at_a_plane(controlled):
    followed = controlled.until(lambda d: np.linalg.norm(d.velocities) > 0.1)
    assert followed.reason == "follows"
    controlled.until(
        lambda _: any(np.abs(c.velocity).max() > 0.1 for c in controlled.peer.commands)
    )
    assert controlled.peer.commands[-1].name == JOINTS
    # A plane 10 m above: the tool is beyond it, so that only the way back is allowed.
    _, jacobian = controlled.node._description.tool.evaluate(np.array(POSITIONS))
    lowered = controlled.until(
        lambda d: (jacobian @ d.velocities)[2] > 0.0, force=(0.0, 0.0, -5.0), plane=FAR_M
    )
    assert lowered.reason == "follows"


@pytest.mark.parametrize(
    ("sent", "reason"),
    [({"tumor": False}, "no_pose"), ({"force": (float("nan"), 0.0, 0.0)}, "no_wrench")],
)
def test_arm_stands_without_a_usable_measurement(controlled, sent, reason):
    controlled.until(lambda d: d.reason == "follows")
    stopped = controlled.until(lambda d: d.reason == reason, **sent)
    assert not stopped.velocities.any()
    assert controlled.node.stops[reason] == 1
    controlled.until(lambda d: d.reason == "follows")


def test_lost_constraint_is_latched_until_an_operator_rearms(controlled):
    controlled.until(lambda d: d.reason == "follows")
    stopped = controlled.until(lambda d: d.reason == "watchdog", constraint=False)
    assert not stopped.velocities.any()
    assert controlled.node.watchdog_stops == 1
    refused = controlled.rearm(constraint=False)
    assert not refused.success
    assert "no constraint arrives; expected a running guard before re-arming" in refused.message
    for _ in range(100):  # a valid constraint changes nothing
        assert not controlled.step().velocities.any()
    assert controlled.rearm().success
    controlled.until(lambda d: d.reason == "follows")


def test_other_guard_stops_the_arm_until_an_operator_rearms(controlled):
    controlled.until(lambda d: d.reason == "follows")
    controlled.peer.instance = "another guard"
    stopped = controlled.until(lambda d: d.reason == "watchdog")
    assert stopped.rule == "instance_changed"
    assert controlled.rearm().success
    controlled.until(lambda d: d.reason == "follows")


def test_arm_takes_the_pose_of_another_tumor_from_the_guard(controlled):
    """Its axes are turned by 90 degrees: beyond the same plane another way leads back."""
    pose, jacobian = controlled.node._description.tool.evaluate(np.array(POSITIONS))
    down = {"force": (0.0, 0.0, 5.0), "plane": FAR_M}  # the tool's z points downwards
    controlled.peer.point_mm = pose.translation_mm
    controlled.until(lambda d: (jacobian @ d.velocities)[2] > 10.0, **down)
    half = np.sqrt(0.5)
    controlled.peer.setup, controlled.peer.tumor_turn = "other", [0.0, half, 0.0, half]
    turned = Rotation.from_quat(controlled.peer.tumor_turn)
    controlled.peer.point_mm = turned.inv().apply(np.array(pose.translation_mm))

    # Now the tumour's z is the base's x, and downwards the hand is free.
    def goes_back_along_x(decision):
        velocity = jacobian @ decision.velocities
        return velocity[0] > 1.0 and velocity[2] < -10.0

    assert controlled.until(goes_back_along_x, **down).reason == "follows"


def test_poses_of_a_message_that_the_rule_refuses_are_not_used(controlled):
    controlled.peer.seq = STEPS  # a step sends several messages on a busy machine
    controlled.until(lambda d: d.reason == "follows")
    controlled.peer.seq = 0  # as a recorded message of another setup would
    controlled.peer.setup, controlled.peer.tumor_turn = "other", [0.0, 0.0, 0.0, 0.5]
    reasons = set()
    controlled.until(lambda d: reasons.add(str(d.reason)) or d.rule == "seq_not_increasing")
    for _ in range(20):
        controlled.peer.seq = 0
        reasons.add(str(controlled.step().reason))
    assert "no_pose" not in reasons


def test_arm_stands_without_a_pose_of_the_tumor(controlled):
    controlled.until(lambda d: d.reason == "follows")
    controlled.peer.tumor_turn = [0.0, 0.0, 0.0, 0.5]
    assert not controlled.until(lambda d: d.reason == "no_pose").velocities.any()


def test_registration_of_the_guard_replaces_a_missing_one(domain_id, project_root):
    description = open_control(project_root / "data" / "worlds" / "lumpectomy")
    with ros_nodes(domain_id, "marginguard_control", "peer") as (ros, peer):
        controlled = Controlled(ros, peer, replace(description, frame_from_base=None))
        controlled.until(lambda d: d.reason == "no_pose" and controlled.peer.seq > 100)
        controlled.peer.base = "base"
        controlled.until(lambda d: d.reason == "follows")


def test_second_sender_of_a_measurement_stops_the_arm(controlled, domain_id):
    controlled.until(lambda d: d.reason == "follows")
    with RosNode("intruder", domain_id=domain_id) as ros:
        other = Peer(
            ros, JOINTS, lambda: controlled.clock_ns() + 1
        )  # the same data are no conflict

        def is_stopped(decision):
            other.send(constraint=False)
            problem = "".join(controlled.node.problems())
            # A publisher may be discovered before its node's name.
            return decision.reason == "no_joints" and "/intruder" in problem and "/peer" in problem

        assert not controlled.until(is_stopped).velocities.any()
        (problem, *_) = controlled.node.problems()
    assert "/arm/measured_js: 2 publishers send" in problem


def test_repeated_constraint_is_read_as_the_message_that_it_is(domain_id):
    """The controller decodes only what follows from another seq; rclpy decodes all of it."""
    with ros_nodes(domain_id, "reader", "guard") as (ros, guard):
        received, publisher = ConstraintInput(ros, CONSTRAINT.name), guard.publisher(CONSTRAINT)
        assert guard.wait_for_subscribers(CONSTRAINT, 1, DEADLINE_S)
        message = FixtureConstraint(instance_id="guard", half_spaces=[HalfSpace(offset=0.5)])
        for seq in range(1, 9):
            message.seq = seq
            message.header.frame_id = "tumor" if seq < 5 else "tumors"  # another place of the seq
            message.hold, message.simulated = seq in (2, 3), seq > 6
            message.half_spaces[0].point_on_tool.x = float(seq // 4)
            found = wait_until(received.arrived, lambda: publisher.publish(message))
            ((read, setup),) = found
            expected = plain_constraint(message)
            for name in PlainConstraint.__slots__:
                np.testing.assert_array_equal(getattr(read, name), getattr(expected, name), name)
            assert setup is None
            assert not read.normals.flags.writeable
    assert received.refused == 0


def test_shipped_file_agrees_with_the_committed_schema(project_root, capsys):
    assert main(["doctor", "schema", "control"]) == 0
    assert capsys.readouterr().out == schema_text(CONTROL, "control")
    committed = project_root / "docs" / "schemas" / "control.schema.json"
    assert committed.read_text() == schema_text(CONTROL, "control"), (
        "run: marginguard doctor schema control -o docs/schemas/control.schema.json"
    )
    shipped = project_root / "data" / "worlds" / "lumpectomy" / "control.yaml"
    jsonschema.Draft202012Validator(json.loads(committed.read_text())).validate(
        yaml.safe_load(shipped.read_text())
    )


TOUCH = {"file": "package://marginguard/robots/touch/touch.urdf"}


def limits(*joints):
    return {"joint_limits": [{"joint": name, "acceleration": 5, "jerk": 50} for name in joints]}


@pytest.mark.parametrize(
    ("key", "value", "problem"),
    [
        ("arm", "arm", "arm is 'arm'; expected a namespace such as /arm"),
        ("speed", 3, "speed is unknown; expected one of"),
        ("constraint", "constraint", "expected a topic that begins with '/'"),
        ("max_speed_mm_s", 300, "max_speed_mm_s is 300"),
        ("tool", {"link": "hook", "position_mm": [0, 0, 0]}, "the tool is held by 'hook'"),
        ("robot", {"file": "none.urdf"}, "none.urdf"),
        ("robot", TOUCH | limits("wing"), r"\[0\].joint is 'wing'; expected one of waist"),
        ("robot", TOUCH | limits("yaw", "yaw"), r"\[1\].joint is 'yaw'; expected .*, once"),
    ],
)
def test_bad_control_file_is_refused_in_one_line(key, value, problem, project_root, tmp_path):
    shipped = project_root / "data" / "worlds" / "lumpectomy" / "control.yaml"
    values = yaml.safe_load(shipped.read_text()) | {key: value}
    path = tmp_path / "control.yaml"
    path.write_text(yaml.safe_dump(values))
    with pytest.raises(Exception, match=problem) as refused:
        open_control(path)
    assert "\n" not in str(refused.value)
    with pytest.raises(InputError, match="is not a control file"):
        open_control(tmp_path / "other.yaml")


IMPEDANCE = {
    "stiffness_n_m": 200.0, "damping_n_s_m": 1.0, "period_ms": 1.0, "arm_damping_n_s_m": 2.0
}  # fmt: skip


def impedance_file(project_root, folder, **changes):
    values = yaml.safe_load((project_root / "data/worlds/lumpectomy/control.yaml").read_text())
    path = folder / "control.yaml"
    path.write_text(yaml.safe_dump({**values, "impedance": {**IMPEDANCE, **changes}}))
    return path


def test_arm_with_a_loop_of_its_own_gets_a_half_axis_and_pause(domain_id, project_root, tmp_path):
    pytest.importorskip("crtk_msgs", reason="pip install ./interfaces_extra")
    from crtk_msgs.msg import CartesianImpedance, StringStamped

    description = open_control(impedance_file(project_root, tmp_path))
    with ros_nodes(domain_id, "marginguard_control", "peer") as (ros, peer_ros):
        found = Controlled(ros, peer_ros, description)
        found.peer.joints, found.peer.positions = JOINTS[::-1], POSITIONS[::-1]
        gains, states = [], []
        peer_ros.subscribe(Topic("/arm/servo_ci", CartesianImpedance, STREAM), gains.append)
        peer_ros.subscribe(Topic("/arm/state_command", StringStamped, STREAM), states.append)
        found.until(lambda _: states, constraint=False)
        assert not gains, "nothing before a valid constraint"
        found.until(lambda d: gains and d.reason == "follows")
        # The constraint's only point on the tool is the origin; the plane is 10 m below it.
        tip, _ = description.tool.evaluate(np.array(POSITIONS))
        message = gains[-1]
        assert message.header.frame_id == "touch_base"
        place = message.force_position
        np.testing.assert_allclose(
            [place.x, place.y, place.z], tip.translation_mm / 1000.0 - [0.0, 0.0, FAR_M], atol=1e-6
        )
        turn = message.force_orientation
        z = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).apply([0.0, 0.0, 1.0])
        np.testing.assert_allclose(z, [0.0, 0.0, 1.0], atol=1e-12)
        assert (message.position_negative.p.z, message.position_negative.d.z) == (-200.0, -1.0)
        assert message.position_positive.p.z == message.position_negative.p.x == 0.0
        states.clear()
        found.until(lambda d: d.reason == "watchdog" and states, constraint=False)
        assert {each.string for each in states} == {"pause"}, "never resume"
        assert not found.peer.commands, "no joint velocities beside it"


def test_impedance_outside_its_bound_is_refused(project_root, tmp_path):
    path = impedance_file(project_root, tmp_path, stiffness_n_m=2000.0)
    with pytest.raises(InputError, match=r"needs a damping of 2 N s/m .*; expected below arm"):
        open_control(path)
