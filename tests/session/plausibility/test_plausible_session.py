"""Sessions with wrong poses: reasons, texts, holds, and that a wrong pose is not used."""

import math
from dataclasses import replace

import numpy as np
import pytest

from app.case import EnvelopeEntry, MotionEntry, PlausibilityEntry, SphereEntry, TrackingFrame
from app.fixture import MarginState, Reason
from app.geometry import NS_PER_MS, Stamp, TrackedTransform, Transform
from app.hold import NotRearmableError
from app.registration import DriftBound, given_registration
from app.session import LiveSession, RobotSetup, Session, SessionSetup
from tests.doubles import PARAMETERS, AnalyticSphere, frame, joint_sample, sample

pytestmark = pytest.mark.slow

SENSORS = {
    "needle": np.array([0.0, 0.0, 0.0]),
    "cautery": np.array([40.0, 0.0, 0.0]),
    "reference": np.array([0.0, 80.0, 0.0]),
}


def make_setup(robot=None, **entry) -> SessionSetup:
    return SessionSetup(
        Transform.identity("cautery", "cautery_tip"),
        Transform.identity("needle", "tumor"),
        AnalyticSphere(10.0),
        PARAMETERS,
        robot,
        plausibility=PlausibilityEntry(**entry),
    )


class Tracker:
    """Sends one frame per 20 ms; ``shift`` displaces sensors, ``turn`` rotates the cautery."""

    def __init__(self, seed: int = 1) -> None:
        self.random = np.random.default_rng(seed)
        self.at_ms = 0.0
        self.shift: dict[str, np.ndarray] = {}
        self.turn = (0.0, 0.0, 0.0)
        self.renamed: dict[str, str] = {}

    def frame(self, joints=()) -> TrackingFrame:
        self.at_ms += 20.0
        samples = []
        for name in SENSORS:
            source = self.renamed.get(name, name)
            position = SENSORS[source] + self.shift.get(name, 0.0)
            turn = self.turn if name == "cautery" else (0.0, 0.0, 0.0)
            samples.append(
                TrackedTransform.valid(
                    Transform.from_rotation_vector(
                        turn + self.random.normal(0.0, 0.001, 3),
                        position + self.random.normal(0.0, 0.15, 3),
                        target="tracker",
                        source=name,
                    ),
                    Stamp(round(self.at_ms * NS_PER_MS)),
                )
            )
        return frame(self.at_ms, *samples, joints=joints)

    def run(self, session, count=150):
        return [session.step(self.frame()) for _ in range(count)]


@pytest.fixture
def running():
    """A session, and its tracker, which has sent 150 frames."""
    session, tracker = Session(make_setup()), Tracker()
    tracker.run(session)
    return session, tracker


def faults(step) -> set[Reason]:
    waiting = {Reason.RECOVERING, Reason.STARTING}
    return {reason for reason in step.decision.reasons if reason.is_fault} - waiting


def test_jump_is_implausible_at_once_is_not_used_and_latches_the_hold():
    session, tracker = Session(make_setup()), Tracker()
    before = tracker.run(session)
    assert {step.decision.state for step in before} == {MarginState.NEGATIVE}
    tracker.shift = {"cautery": np.array([0.0, 100.0, 0.0])}
    step = session.step(tracker.frame())
    assert faults(step) == {Reason.IMPLAUSIBLE}
    assert step.decision.hold
    assert step.frames_problem.startswith("implausible pose: tracker -> cautery jumps by ")
    assert step.hold_causes[0] == step.frames_problem
    assert step.tumor_from_tip.translation_mm[1] < 1.0, "the last plausible pose"
    after = tracker.run(session, 30)
    assert after[-1].decision.state is not MarginState.UNKNOWN
    assert after[-1].decision.hold
    assert {each.frames_problem for each in after} == {step.frames_problem, ""}
    assert len(after[-1].hold_causes) <= 2, "one text, although its numbers change"
    session.rearm()
    assert not session.step(tracker.frame()).decision.hold


def test_turn_by_180_degrees_is_implausible(running):
    session, tracker = running
    tracker.turn = (0.0, math.pi, 0.0)
    step = session.step(tracker.frame())
    assert faults(step) == {Reason.IMPLAUSIBLE}
    assert "tracker -> cautery turns by 1" in step.frames_problem


def test_swapped_tool_and_tumour_are_both_implausible(running):
    session, tracker = running
    tracker.renamed = {"needle": "cautery", "cautery": "needle"}
    step = session.step(tracker.frame())
    assert faults(step) == {Reason.IMPLAUSIBLE}
    assert "tracker -> cautery" in step.frames_problem
    assert "tracker -> needle" in step.frames_problem


def test_jump_of_a_sensor_that_is_not_used_is_no_fault(running):
    session, tracker = running
    tracker.shift = {"reference": np.array([0.0, 500.0, 0.0])}
    assert faults(session.step(tracker.frame())) == set()


def test_configured_limits_are_used_and_can_be_replaced():
    slow = {"motion": MotionEntry(2000.0, 300.0, 20.0, 250.0)}
    session, tracker = Session(make_setup(**slow)), Tracker()
    tracker.run(session)
    tracker.shift = {"cautery": np.array([0.0, 5.0, 0.0])}
    assert faults(session.step(tracker.frame())) == {Reason.IMPLAUSIBLE}
    usual, tracker = Session(make_setup(**slow)), Tracker()
    tracker.run(usual)
    usual.use(replace(usual.setup, plausibility=PlausibilityEntry()))
    tracker.shift = {"cautery": np.array([0.0, 5.0, 0.0])}
    assert faults(usual.step(tracker.frame())) == set()


def test_clock_that_jumps_back_is_no_implausible_pose(running):
    session, tracker = running
    tracker.at_ms, tracker.shift = 0.0, {"cautery": np.array([0.0, 300.0, 0.0])}
    assert faults(session.step(tracker.frame())) == {Reason.CLOCK_JUMPED_BACK}
    assert faults(tracker.run(session, 10)[-1]) == set()


def test_creep_of_the_needle_contradicts_its_pair_and_ends_with_it():
    pair = EnvelopeEntry("reference", "needle", max_mm=6.0, max_rad=0.2)
    session, tracker = Session(make_setup(pairs=(pair,))), Tracker()
    assert {frozenset(faults(step)) for step in tracker.run(session, 300)} == {frozenset()}
    creeping = []
    for _ in range(250):
        tracker.shift = {"needle": tracker.shift.get("needle", 0.0) + np.array([0.0, 0.04, 0.0])}
        creeping.append(session.step(tracker.frame()))
    found = [step for step in creeping if faults(step)]
    assert {frozenset(faults(step)) for step in found} == {frozenset({Reason.CONTRADICTION})}
    first_mm = 0.04 * (creeping.index(found[0]) + 1)
    assert 5.0 < first_mm < 7.0
    text = found[0].frames_problem
    assert text.startswith("contradiction: needle in reference is 6")
    assert "expected at most 6 mm and " in text
    assert len(found[-1].hold_causes) <= 2


def test_another_tip_ends_no_contradiction_and_forgets_no_relation_of_two_sensors():
    """A needle that has slipped by 10 mm is no new normal after a calibration of the tool."""
    pair = EnvelopeEntry("reference", "needle", max_mm=6.0, max_rad=0.2)
    session, tracker = Session(make_setup(pairs=(pair,))), Tracker()
    tracker.run(session, 300)
    for _ in range(250):
        tracker.shift = {"needle": tracker.shift.get("needle", 0.0) + np.array([0.0, 0.04, 0.0])}
        step = session.step(tracker.frame())
    assert faults(step) == {Reason.CONTRADICTION}
    tip = Transform("cautery", "cautery_tip", np.eye(3), [0.0, 0.0, 0.2])
    session.use(replace(session.setup, tool_from_tip=tip))
    after = tracker.run(session, 400)
    assert {frozenset(faults(step)) for step in after} == {frozenset({Reason.CONTRADICTION})}
    with pytest.raises(NotRearmableError):
        session.rearm()


def test_relation_without_its_frame_is_lost_redundancy():
    pair = EnvelopeEntry("reference", "markers", max_mm=6.0, max_rad=0.2)
    session, tracker = Session(make_setup(pairs=(pair,))), Tracker()
    step = tracker.run(session, 5)[-1]
    assert Reason.REDUNDANCY_LOST in faults(step)
    expected = "nothing checks the tracker: markers in reference is not known"
    assert step.frames_problem == expected


def robot_setup(touch, max_drift_mm=5.0) -> tuple[RobotSetup, dict[str, float]]:
    """A robot whose stylus is at the cautery of `SENSORS`, and its joints."""
    joints = dict.fromkeys(touch.actuated_joint_names, 0.1)
    tip_mm = touch.forward_kinematics(joints)["stylus"].translation_mm
    at_tool = SENSORS["cautery"] - SENSORS["reference"] - tip_mm
    given = given_registration(Transform("reference", "robot_base", np.eye(3), at_tool))
    bound = DriftBound(max_drift_mm, 0.05)
    return RobotSetup(touch, "robot_base", "stylus", given, bound), joints


def held(session, tracker, joints, count=150):
    """Steps with joints of the present."""
    return [
        session.step(tracker.frame((joint_sample(joints, tracker.at_ms + 20.0),)))
        for _ in range(count)
    ]


def test_creep_is_found_by_joints_below_the_bound_of_a_single_difference(touch):
    robot, joints = robot_setup(touch)
    session, tracker = Session(make_setup(robot)), Tracker()
    assert {frozenset(faults(step)) for step in held(session, tracker, joints)} == {frozenset()}
    for number in range(1, 200):
        tracker.shift = {"cautery": np.array([0.0, 0.04 * number, 0.0])}  # 2 mm/s
        (step,) = held(session, tracker, joints, 1)
        if faults(step):
            break
    assert faults(step) == {Reason.REGISTRATION_DRIFT}
    assert step.drift.accepted
    assert 2.0 < 0.04 * number < 3.5
    assert "in the mean; expected at most 2.5 mm" in step.frames_problem
    # Joints that stop do not end the drift.
    later = tracker.run(session, 20)[-1]
    assert {Reason.REGISTRATION_DRIFT, Reason.REDUNDANCY_LOST} <= faults(later)


def test_configured_limit_of_the_mean_is_used(touch):
    robot, joints = robot_setup(touch)
    session, tracker = Session(make_setup(robot, mean_drift_mm=1.0)), Tracker()
    held(session, tracker, joints)
    tracker.shift = {"cautery": np.array([0.0, 1.5, 0.0])}
    assert Reason.REGISTRATION_DRIFT in faults(held(session, tracker, joints, 50)[-1])


def test_jump_against_the_registration_error_is_found_with_its_second_sample(touch):
    """The mean of the difference stays within 2.5 mm: only its change shows the jump of 4 mm."""
    robot, joints = robot_setup(touch)
    session, tracker = Session(make_setup(robot)), Tracker()
    tracker.shift = {"cautery": np.array([0.0, -2.0, 0.0])}
    assert {frozenset(faults(step)) for step in held(session, tracker, joints)} == {frozenset()}
    tracker.shift = {"cautery": np.array([0.0, 2.0, 0.0])}
    first, second = held(session, tracker, joints, 2)
    assert faults(first) == set()
    assert faults(second) == {Reason.REGISTRATION_DRIFT}
    assert second.decision.state is MarginState.UNKNOWN
    assert second.decision.hold
    assert "within two samples; expected at most 2.5 mm" in second.frames_problem
    # It lasts for as long as the tool is there, and cannot be re-armed.
    assert faults(held(session, tracker, joints, 500)[-1]) == {Reason.REGISTRATION_DRIFT}
    with pytest.raises(NotRearmableError):
        session.rearm()
    tracker.shift = {"cautery": np.array([0.0, -2.0, 0.0])}
    assert faults(held(session, tracker, joints, 50)[-1]) == set()


def test_jump_is_found_when_each_sensor_has_a_frame_of_its_own(touch):
    """Sensors of tf are stamped one after another; joints come with every third frame."""
    robot, joints = robot_setup(touch)
    session, tracker = Session(make_setup(robot)), Tracker()
    found_ms, jumped_ms = [], 3000.0
    for _ in range(160):
        if tracker.at_ms == jumped_ms:
            tracker.shift = {"cautery": np.array([0.0, 4.0, 0.0])}
        whole = tracker.frame()
        for late_ms, each in zip((-4.0, -2.0, 0.0), whole.poses, strict=True):
            at_ms = tracker.at_ms + late_ms
            stamped = replace(each, stamp=Stamp(round(at_ms * NS_PER_MS)))
            own = () if late_ms else (joint_sample(joints, at_ms - 1.0),)
            if Reason.REGISTRATION_DRIFT in faults(session.step(frame(at_ms, stamped, joints=own))):
                found_ms.append(at_ms)
    assert jumped_ms + 20.0 <= found_ms[0] <= jumped_ms + 40.0


def test_silent_joints_are_lost_redundancy_at_once_and_latch_the_hold(touch):
    robot, joints = robot_setup(touch)
    session, tracker = Session(make_setup(robot)), Tracker()
    assert held(session, tracker, joints)[-1].decision.hold is False
    silent = tracker.run(session, 15)
    stale_steps = PARAMETERS.stale_after_ns // (20 * NS_PER_MS)
    reasons = [Reason.REDUNDANCY_LOST in faults(step) for step in silent]
    assert reasons == [False] * stale_steps + [True] * (15 - stale_steps)
    assert silent[-1].frames_problem == "nothing checks the tracker: no joint positions"
    again = held(session, tracker, joints, 10)[-1]
    assert again.decision.state is MarginState.NEGATIVE
    assert again.decision.hold


def test_joints_that_never_come_keep_the_margin_unknown(touch):
    robot, _ = robot_setup(touch)
    session, tracker = Session(make_setup(robot)), Tracker()
    steps = tracker.run(session, 20)
    assert {step.decision.state for step in steps} == {MarginState.UNKNOWN}
    assert all(Reason.REDUNDANCY_LOST in faults(step) for step in steps)


def test_workspace_in_the_base_of_the_robot_uses_the_registration(touch):
    robot, joints = robot_setup(touch)
    tip_mm = tuple(touch.forward_kinematics(joints)["stylus"].translation_mm.tolist())
    for radius_mm, expected in ((5.0, set()), (0.01, {Reason.CONTRADICTION})):
        sphere = SphereEntry("robot_base", tip_mm, radius_mm)
        session, tracker = Session(make_setup(robot, workspace=sphere)), Tracker()
        assert faults(held(session, tracker, joints, 5)[-1]) == expected


@pytest.mark.parametrize(
    ("joints", "relation", "single"),
    [(False, False, True), (True, False, False), (False, True, False)],
)
def test_single_source_without_joints_and_relations(touch, joints, relation, single):
    robot = robot_setup(touch)[0] if joints else None
    sphere = SphereEntry("reference", (0.0, 0.0, 0.0), 500.0) if relation else None
    session = Session(make_setup(robot, workspace=sphere))
    assert session.single_source == single
    assert session.step(Tracker().frame()).single_source == single


def test_robot_that_follows_the_tool_checks_nothing(touch):
    robot = replace(robot_setup(touch)[0], follows_tool=True)
    assert Session(make_setup(robot)).single_source


def test_live_session_takes_the_frames_of_relations_from_the_tracker():
    pair = EnvelopeEntry("reference", "needle", max_mm=6.0, max_rad=0.2)
    live = LiveSession(
        Session(make_setup(pairs=(pair,))), host_ns=lambda: 10**9, stamps_of_host=True
    )
    live.add([sample("tracker", name, tuple(place), 999.0) for name, place in SENSORS.items()])
    assert ("tracker", "reference") in live.edges
