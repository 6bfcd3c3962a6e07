"""Live session in simulated time: times of the steps; old poses make the margin unknown."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.case import Activation
from app.fixture import MarginState, Reason
from app.geometry import NS_PER_MS, Stamp, TrackedTransform, TrackingStatus, Transform
from app.hold import NotRearmableError
from app.registration import DriftBound, given_registration
from app.session import LiveSession, RobotSetup, Session, SessionSetup, Structure
from app.session.live_session import NO_PLAYBACK, PlaybackRule
from tests.doubles import PARAMETERS, AnalyticSphere, joint_sample, lost, sample

pytestmark = pytest.mark.slow

STALE_MS = PARAMETERS.stale_after_ns // NS_PER_MS
HOST_MS = 5_000_000
"""Time of the host's clock when the tracker's is 0."""


class SimulatedHost:
    """Live session with a simulated clock of the host (``ns``) and scheduled events.

    Times are in ms after the start, which is `HOST_MS`. The session calls `wait`, which advances
    the clock to the next event or by the given time.
    """

    def __init__(
        self,
        stamps_of_host: bool = False,
        robot=None,
        edges=(),
        playback=NO_PLAYBACK,
        source_problem=lambda: "",
        activation=None,
        shown_frames=(),
        other_tools=(),
    ) -> None:
        self.ns = HOST_MS * NS_PER_MS
        self.events = []
        identity = Transform.identity
        self.setup = SessionSetup(
            identity("cautery", "cautery_tip"),
            identity("needle", "tumor"),
            AnalyticSphere(10.0),
            PARAMETERS,
            robot,
            shown_frames=shown_frames,
            other_tools=other_tools,
        )
        self.live = LiveSession(
            Session(self.setup),
            host_ns=lambda: self.ns,
            stamps_of_host=stamps_of_host,
            edges=edges,
            playback=playback,
            wait=self.wait,
            source_problem=source_problem,
            activation=activation,
        )

    def at(self, ms, action):
        """Schedule a call of ``action``."""
        self.events.append((round((HOST_MS + ms) * NS_PER_MS), len(self.events), action))

    def arrive(self, ms, *samples):
        """Schedule the arrival of ``samples`` at the session."""
        self.at(ms, lambda: self.live.add(samples))

    def wait(self, _, seconds):
        """Run the next event if it is due within ``seconds``; otherwise advance the clock."""
        until_ns = self.ns + max(1, round(seconds * 1e9))
        if self.events and min(self.events)[0] <= until_ns:
            due = min(self.events)
            self.events.remove(due)
            self.ns = max(self.ns, due[0])
            due[2]()
        else:
            self.ns = until_ns

    def rearm(self):
        with self.live.between_steps() as session:
            session.rearm()

    def run(self, until_ms):
        """Step until ``until_ms``; return the time in ms and the result of each step."""
        self.at(until_ms, self.live.stop)
        return [(self.ns / NS_PER_MS - HOST_MS, step) for step in self.live.steps()]


def needle(at_ms):
    return sample("tracker", "needle", (0.0, 0.0, 0.001 * at_ms), at_ms)


def cautery(at_ms, distance_mm=20.0):
    return sample("tracker", "cautery", (10.0 + distance_mm, 0.0, 0.001 * at_ms), at_ms)


def track(host, start_ms, end_ms, period_ms=20, delay_ms=3.0):
    """Schedule a needle and a cautery sample per period, each in its own message."""
    for at_ms in range(start_ms, end_ms, period_ms):
        host.arrive(at_ms + delay_ms, needle(at_ms))
        host.arrive(at_ms + delay_ms + 0.2, cautery(at_ms))


def tracked(start_ms, end_ms, *, period_ms=20, delay_ms=3.0, **options):
    """A host that gets the samples of `track`."""
    host = SimulatedHost(**options)
    track(host, start_ms, end_ms, period_ms, delay_ms)
    return host


def send_joints(host, times, *, ahead_ms=0, of_host=False):
    """Schedule joints, stamped ``ahead_ms`` (or as a function of their time) too late."""
    for at_ms in times:
        ahead = ahead_ms(at_ms) if callable(ahead_ms) else ahead_ms
        joints = joint_sample({"waist": 0.001 * at_ms}, at_ms + ahead)
        host.at(max(at_ms + 3.0, 0.0), partial(host.live.add_joints, joints, of_host=of_host))


def joint_ages_ms(steps, after_ms):
    """Age of the joints of each step after ``after_ms``, by its time."""
    return {
        at: step.joints.stamp.age_ns(step.frame.stamp) / NS_PER_MS
        for at, step in steps
        if at > after_ms
    }


def unknown(steps):
    return {step.decision.state for step in steps} == {MarginState.UNKNOWN}


def test_state_is_unknown_before_the_first_sample():
    steps = SimulatedHost().run(350)
    assert [at for at, _ in steps] == pytest.approx([0.0, 100.0, 200.0, 300.0])
    for _, step in steps:
        assert step.decision.state is MarginState.UNKNOWN
        assert step.decision.hold
        assert step.frame.stamp == Stamp(0)


def test_frame_is_stepped_on_arrival_of_its_last_sample():
    host = tracked(0, 200)
    frames = [(at, step) for at, step in host.run(195) if step.frame.poses]
    # The first frames determine which samples form a group; later ones do not wait.
    grouped = [(at, step) for at, step in frames if at > 60]
    assert [at for at, _ in grouped] == pytest.approx([63.2 + 20 * index for index in range(7)])
    for _, step in grouped:
        assert len(step.frame.poses) == 2
        assert step.decision.state is MarginState.NEGATIVE
        assert step.decision.proximity.signed_distance_mm == pytest.approx(20.0)


def test_cautery_is_in_each_frame_and_changes_no_decision():
    states = [Activation.UNKNOWN, Activation.OFF, Activation.ON]
    told = iter(states * 1000)
    hosts = tracked(0, 200, activation=lambda: next(told)), tracked(0, 200)
    with_cautery, without = (host.run(400) for host in hosts)
    assert {step.frame.activation for _, step in with_cautery} == set(states)
    assert {step.frame.activation for _, step in without} == {None}
    judged = [
        [(at, s.decision.state, s.decision.reasons, s.decision.hold, s.index) for at, s in steps]
        for steps in (with_cautery, without)
    ]
    assert judged[0] == judged[1]


def test_silent_source_is_stale_at_once_and_stays_held():
    host = tracked(0, 200)
    track(host, 800, 1200)
    steps = host.run(1100)
    last_ms = 180
    known = [(at, step) for at, step in steps if step.decision.state is not MarginState.UNKNOWN]
    silent = [(at, step) for at, step in steps if last_ms + 10 < at < 800]
    # The estimated offset of the clocks contains the latency of the fastest sample, 3 ms.
    assert silent[0][0] == pytest.approx(last_ms + STALE_MS + 3, abs=0.2)
    for _, step in silent:
        assert step.decision.state is MarginState.UNKNOWN
        assert Reason.STALE in step.decision.reasons
    gaps = np.diff([at for at, _ in silent])
    assert gaps == pytest.approx(np.full(len(gaps), 100.0), abs=1.0)
    back = [step for at, step in known if at > 800]
    assert back
    assert all(step.decision.hold for step in back)


def test_silent_source_with_host_clock_is_stale_to_the_nanosecond():
    host = SimulatedHost(stamps_of_host=True)
    for at_ms in range(0, 200, 20):
        host.arrive(at_ms + 3, needle(HOST_MS + at_ms), cautery(HOST_MS + at_ms))
    known, stale = [step for at, step in host.run(450) if at > 180][:2]
    assert known.decision.state is MarginState.NEGATIVE
    assert Reason.STALE in stale.decision.reasons
    assert stale.decision.stamp.age_ns(stale.frame.stamp) == PARAMETERS.stale_after_ns + 1


def test_own_published_edges_are_not_used():
    """The tumour's edge, which we publish on /tf, and the tool measured relative to it."""
    host = SimulatedHost()
    host.arrive(0, sample("needle", "tumor", (9.0, 9.0, 9.0), 0))
    host.arrive(0, sample("tumor", "cautery", (9.0, 9.0, 9.0), 0))
    track(host, 0, 100)
    assert host.run(95)[-1][1].decision.proximity.signed_distance_mm == pytest.approx(20.0)
    assert host.live.edges == (("tracker", "cautery"), ("tracker", "needle"))


def test_rearm_is_refused_while_unknown_and_releases_hold_afterwards():
    host = tracked(0, 200)
    track(host, 800, 1400)
    refusals = []

    def rearm_during_silence():
        with pytest.raises(NotRearmableError):
            host.rearm()
        refusals.append(True)

    host.at(600, rearm_during_silence)
    host.at(1000, host.rearm)
    steps = host.run(1300)
    assert refusals
    held = {at: step.decision.hold for at, step in steps if at > 850}
    assert {hold for at, hold in held.items() if at < 1000} == {True}
    assert {hold for at, hold in held.items() if at > 1001} == {False}


def test_session_slower_than_its_source_steps_the_newest_samples():
    host = SimulatedHost()
    track(host, 0, 1000, period_ms=1)  # 1 kHz
    host.at(1005, host.live.stop)
    ages, poses = [], 0
    for step in host.live.steps():
        poses += len(step.frame.poses)
        if step.decision.stamp is not None:
            ages.append(step.decision.stamp.age_ns(step.frame.stamp) / NS_PER_MS)
        # A step takes 30 ms, in which 30 frames arrive.
        until_ns = host.ns + 30 * NS_PER_MS
        while host.events and min(host.events)[0] <= until_ns:
            host.wait(None, 0.03)
        host.ns = max(host.ns, until_ns)
    assert poses < 100
    assert max(ages[2:]) < 10.0
    assert host.live.left_out()["samples that a newer one replaced"] > 1000


def test_lost_tool_is_unknown_with_the_trackers_reason():
    host = tracked(0, 100)
    host.arrive(103, needle(100), lost("tracker", "cautery", 100, TrackingStatus.OUT_OF_VIEW))
    step = next(step for at, step in host.run(115) if at > 102)
    assert step.decision.state is MarginState.UNKNOWN
    assert Reason.MISSING in step.decision.reasons


@pytest.mark.parametrize("invalid", range(5))
def test_lost_pose_is_not_hidden_by_newer_samples_of_the_same_batch(invalid):
    """A stall of 60 ms: four periods of samples wait, one of them with a lost pose."""
    host = tracked(0, 100)
    host.run(110)
    host.live.resume()
    times = [100, 115, 130, 145, 160]
    samples = [
        lost("tracker", "cautery", at, TrackingStatus.INVALID) if n == invalid else cautery(at)
        for n, at in enumerate(times)
    ]
    host.arrive(163, *(needle(at) for at in times), *samples)
    steps = [step for at, step in host.run(200) if at > 162]
    found = [Reason.INVALID in step.decision.reasons for step in steps]
    assert found == ([True] if invalid == 4 else [True, False])
    assert all(step.decision.hold for step in steps)
    assert invalid == 4 or steps[-1].decision.stamp.ns == 160 * NS_PER_MS


class SlowLock:
    """Test double of a lock that others hold for ``wait_ms`` at its ``entry``-th use."""

    def __init__(self, host, wait_ms, entry):
        self.host, self.wait_ms, self.left = host, wait_ms, entry

    def __enter__(self):
        self.left -= 1
        if self.left == 0:
            self.host.ns += self.wait_ms * NS_PER_MS

    def __exit__(self, *_):
        pass


def test_frame_delayed_by_a_change_of_the_session_keeps_its_true_age():
    host = tracked(0, 400)
    host.live._stepping = SlowLock(host, wait_ms=1500, entry=9)
    steps = host.live.steps()
    before = [next(steps) for _ in range(8)]
    assert before[-1].decision.state is MarginState.NEGATIVE
    late = next(steps).decision
    assert late.state is MarginState.UNKNOWN
    assert Reason.STALE in late.reasons


def test_restarted_source_clock_is_detected_and_followed():
    host = SimulatedHost()
    for start_ms, tracker_ms in ((0, 50_000), (1000, 100)):
        for at_ms in range(0, 600, 20):
            host.arrive(start_ms + at_ms, needle(tracker_ms + at_ms), cautery(tracker_ms + at_ms))
    steps = host.run(1500)
    jumped = [at for at, s in steps if Reason.CLOCK_JUMPED_BACK in s.decision.reasons]
    assert len(jumped) == 1
    assert jumped[0] == pytest.approx(1000.0, abs=6.0)
    assert steps[-1][1].decision.state is MarginState.NEGATIVE
    assert steps[-1][1].frame.stamp.ns < 1000 * NS_PER_MS


@pytest.mark.parametrize("stamps_of_host", [True, False])
@pytest.mark.parametrize("ahead_ms", [300, 3_600_000])
def test_one_future_stamp_is_one_fault(stamps_of_host, ahead_ms):
    host = SimulatedHost(stamps_of_host)
    zero_ms = HOST_MS if stamps_of_host else 0
    for at_ms in range(0, 2000, 20):
        wrong_ms = ahead_ms if at_ms == 1000 else 0
        pose = cautery(zero_ms + at_ms, 30.0).transform
        stamp = Stamp((zero_ms + at_ms + wrong_ms) * NS_PER_MS)
        host.arrive(at_ms + 3.0, needle(zero_ms + at_ms), TrackedTransform.valid(pose, stamp))
    steps = host.run(1990)
    faulty = [(at, s.decision) for at, s in steps if at > 100 and s.decision.hold]
    assert faulty[0][0] == pytest.approx(1003.0, abs=6.0)
    faults = [{r for r in d.reasons if r.is_fault} - {Reason.RECOVERING} for _, d in faulty]
    nonempty = [reasons for reasons in faults if reasons]
    assert set().union(*nonempty) == {Reason.FUTURE_STAMP}
    assert len(nonempty) <= 5
    last = steps[-1][1]
    assert last.decision.state is MarginState.NEGATIVE
    assert last.decision.stamp.age_ns(last.frame.stamp) < 30 * NS_PER_MS


def test_live_session_can_be_stopped_and_resumed():
    host = tracked(0, 600)
    assert host.run(290)
    host.live.resume()
    again = host.run(590)
    assert again[0][0] >= 290
    assert len(again) >= 14


def test_host_clock_set_back_does_not_delay_the_watchdog_step():
    host = tracked(0, 200)

    def set_back():
        host.ns -= 3_600_000 * NS_PER_MS

    host.at(190, set_back)
    host.at(190.1, lambda: None)
    steps = []
    for step in host.live.steps():
        steps.append(step)
        if host.ns < (HOST_MS - 1000) * NS_PER_MS and len(steps) > 13:
            host.live.stop()
    assert steps[-1].decision.state is MarginState.UNKNOWN


def test_number_of_kept_edges_is_bounded():
    host = SimulatedHost()
    for index in range(400):
        host.arrive(index, sample(f"frame{index}", f"child{index}", (1.0, 2.0, 3.0), index))
    host.arrive(401, sample("tracker", "x" * 1000, (1.0, 2.0, 3.0), 401))
    host.run(410)
    left_out = host.live.left_out()
    assert left_out["edges beyond 256"] == 400 - 256
    assert left_out["frame names of more than 256 letters"] == 1
    assert host.live.edges == ()


def problems_of(steps):
    """Distinct ``frames_problem`` texts in order, with the time in ms of the first step of each."""
    problems = {}
    for at, step in steps:
        problems.setdefault(step.frames_problem, at)
    return problems


@pytest.mark.parametrize(
    ("sent", "message"),
    [
        (
            [("tracker", "cautary"), ("tracker", "needle")],
            "tool.frame is 'cautery': not among what the tracker sends so far, cautary, needle, "
            "tracker",
        ),
        (
            [("tracker", "stylus")],
            "tool.frame is 'cautery' and tumor.frame is 'needle': not among what the tracker "
            "sends so far, stylus, tracker",
        ),
        (
            [("tracker", "cautery"), ("camera", "needle")],
            "tumor.frame is 'needle': not connected to tool.frame 'cautery' by what the "
            "tracker sends so far, tracker -> cautery, camera -> needle",
        ),
    ],
)
def test_missing_frame_is_reported_with_the_received_ones(sent, message):
    host = SimulatedHost()
    for at_ms in range(0, 2500, 20):
        host.arrive(at_ms, *(sample(*edge, (1.0, 2.0, 0.001 * at_ms), at_ms) for edge in sent))
    steps = host.run(2400)
    assert problems_of(steps) == {"": 0.0, message: pytest.approx(2000.0, abs=100.0)}
    assert unknown(step for _, step in steps)


def test_late_frame_is_reported_missing_until_it_arrives():
    host = SimulatedHost()
    for at_ms in range(0, 5000, 20):
        host.arrive(at_ms, needle(at_ms), *([cautery(at_ms)] if at_ms >= 3000 else []))
    steps = host.run(4900)
    assert [at for at, step in steps if step.frames_problem] == pytest.approx(
        [at for at, _ in steps if 2000 <= at < 3000]
    )
    assert steps[-1][1].decision.state is MarginState.NEGATIVE


def test_complete_source_has_no_missing_frames():
    assert set(problems_of(tracked(1500, 4000).run(3900))) == {""}


def test_source_that_sends_nothing_is_reported_until_it_does():
    host = tracked(3000, 6000)
    steps = host.run(5900)
    silent = [at for at, step in steps if "no pose has come so far" in step.frames_problem]
    assert (silent[0], silent[-1]) == pytest.approx((2000.0, 2900.0), abs=100.0)
    told = [step.frames_problem for at, step in steps if silent[0] <= at <= silent[-1]]
    assert len(set(told)) == 1
    assert "expected poses of 'cautery', 'needle'" in told[0]
    assert steps[-1][1].frames_problem == ""


def test_problem_of_the_source_is_the_first_one():
    gone = ["OpenIGTLink server tracker:18944: cannot reach"]
    host = tracked(0, 1000, source_problem=lambda: gone[0])
    steps = host.run(900)
    assert {step.frames_problem for _, step in steps} == set(gone)


@pytest.mark.parametrize(
    ("edges", "message", "used"),
    [
        (
            [("tracker", "needle"), ("tracker", "cautary")],
            "source.tf.edges has tracker -> cautary: not sent by the tracker so far; it sends "
            "tracker -> needle, tracker -> cautery",
            [("tracker", "needle")],
        ),
        (
            [("tracker", "needle")],
            "tool.frame is 'cautery': not among what source.tf.edges has, needle, tracker",
            [("tracker", "needle")],
        ),
    ],
    ids=["never arrives", "does not connect the tool"],
)
def test_named_edges_that_cannot_be_used_are_reported(edges, message, used):
    host = tracked(0, 3000, edges=edges)
    assert list(problems_of(host.run(2900))) == ["", message]
    assert host.live.edges == tuple(used)


def test_report_on_received_frame_names_has_bounded_length():
    host = SimulatedHost()
    for index in range(400):
        name = f"{index:03}" + "x" * 250
        host.arrive(index, sample(f"a{name}", f"b{name}", (1.0, 2.0, 3.0), index))
    host.at(2500, lambda: None)
    _, message = problems_of(host.run(2600))
    assert message.startswith("tool.frame is 'cautery' and tumor.frame is 'needle': not among")
    assert message.endswith(", 492 more")
    assert len(message) < 1200


@pytest.mark.parametrize("measured", [("tracker", "robot_base"), ("robot_base", "tracker")])
def test_measured_robot_base_makes_margin_unknown_and_is_reported(touch, measured):
    """The registration would place the base a second time, and tf would alternate."""
    given = given_registration(Transform.identity("reference", "robot_base"))
    robot = RobotSetup(touch, "robot_base", "stylus", given, DriftBound(1e6, 4.0))
    host = tracked(0, 1000, robot=robot)
    for at_ms in range(0, 1000, 5):
        joints = joint_sample(dict.fromkeys(touch.actuated_joint_names, 0.0), at_ms)
        host.at(at_ms + 3.0, partial(host.live.add_joints, joints, of_host=False))
    for at_ms in range(0, 1000, 20):
        host.arrive(at_ms + 3.1, sample("tracker", "reference", (0.0, 0.0, 1e-3 * at_ms), at_ms))
        own = sample("reference", "robot_base", (0.0, 0.0, 0.0), at_ms)  # our own edge, returned
        host.arrive(at_ms + 3.1, own, sample("robot_base", "link", (0.0, 0.0, 9.0), at_ms))
        if at_ms >= 500:
            host.arrive(at_ms + 3.2, sample(*measured, (9.0, 0.0, 1e-3 * at_ms), at_ms))
    steps = host.run(990)
    before = [step for at, step in steps if 100 < at < 503]
    after = [step for at, step in steps if at > 510]
    assert {step.decision.state for step in before} == {MarginState.NEGATIVE}
    assert {step.frames_problem for step in before} == {""}
    for step in after:
        assert step.decision.state is MarginState.UNKNOWN
        assert step.decision.hold
        assert step.decision.reasons[0] is Reason.REGISTRATION_REFUSED
        assert step.frames_problem.startswith("robot.base_frame is 'robot_base'; ")
        assert f"{measured[0]} -> {measured[1]}" in step.frames_problem
    assert len(after) > 20


@pytest.mark.parametrize("ahead_ms", [0, 29, 150])
def test_joints_ahead_of_the_tracker_wait_for_its_present(ahead_ms):
    """A tracker that stamps late, with an offset of the robot's clock to match."""
    host = tracked(0, 1000)
    send_joints(host, range(-200, 1000, 5), ahead_ms=ahead_ms)
    ages_ms = joint_ages_ms(host.run(990), 200).values()
    assert len(ages_ms) > 30
    assert 0.0 <= min(ages_ms) <= max(ages_ms) <= 10.0
    assert host.live.left_out().get("joints that came late", 0) == 0


def test_joints_far_ahead_are_reported_at_once_and_do_not_stay():
    host = tracked(0, 600)
    send_joints(host, range(0, 600, 5), ahead_ms=lambda at_ms: 1000 if at_ms == 300 else 0)
    ages_ms = joint_ages_ms(host.run(590), 100)
    assert [at for at, age_ms in ages_ms.items() if age_ms < 0.0] == [pytest.approx(303.2, abs=21)]
    assert max(ages_ms.values()) <= 25.0


@pytest.mark.parametrize(("of_host", "robot_ms"), [(True, HOST_MS), (False, 0)])
def test_joints_are_converted_to_the_source_clock_once(of_host, robot_ms):
    host = tracked(0, 200, delay_ms=0.0)
    send_joints(host, range(1, 200, 10), ahead_ms=robot_ms + 3.0, of_host=of_host)
    last = host.run(199)[-1][1]
    assert 0.0 <= last.joints.stamp.age_ns(last.frame.stamp) / NS_PER_MS <= 11.0


@settings(max_examples=60)
@given(
    st.lists(
        st.tuples(
            st.floats(0.0, 60.0),  # ms until the next sample
            st.sampled_from(["needle", "cautery", "lost", "robot", "own"]),
            st.floats(-2000.0, 2000.0) | st.just(0.0) | st.just(0.0),  # stamp error, ms
        ),
        max_size=60,
    ),
    st.booleans(),
)
def test_known_state_always_rests_on_fresh_poses(arrivals, stamps_of_host):
    host = SimulatedHost(stamps_of_host)
    zero_ms = HOST_MS if stamps_of_host else 10_000
    at_ms = 0.0
    for wait_ms, what, error_ms in arrivals:
        at_ms += wait_ms
        stamp_ms = zero_ms + at_ms + error_ms
        made = {
            "needle": needle,
            "cautery": cautery,
            "lost": lambda at: lost("tracker", "cautery", at, TrackingStatus.MISSING),
            "robot": lambda at: sample("base", "link", (1.0, 2.0, 3.0), at),
            "own": lambda at: sample("needle", "tumor", (9.0, 9.0, 9.0), at),
        }[what](stamp_ms)
        host.arrive(at_ms, made)
    end_ms = at_ms + 1000
    steps = host.run(end_ms)
    for _, step in steps:
        if step.decision.state is not MarginState.UNKNOWN:
            age_ns = step.decision.stamp.age_ns(step.frame.stamp)
            assert 0 <= age_ns <= PARAMETERS.stale_after_ns
    # After a second without samples no step may have a known state.
    assert steps[-1][1].decision.state is MarginState.UNKNOWN
    gaps = np.diff([at for at, _ in steps])
    assert gaps.max(initial=0.0) <= STALE_MS + 1.0
    assert set(host.live.edges) <= {("tracker", "needle"), ("tracker", "cautery")}


def test_spent_ns_is_the_age_of_the_last_step():
    host = tracked(0, 100)
    host.at(90, host.live.stop)
    for _ in host.live.steps():
        assert host.live.spent_ns() == 0
        host.ns += 3
        assert host.live.spent_ns() == 3
        host.ns -= 5  # the host's clock was set back
        assert host.live.spent_ns() == 0


def test_samples_that_waited_during_a_stop_of_the_process_are_not_young():
    """The first samples fill the buffer of the socket during the stop; later ones are lost."""
    host = tracked(1050, 1400)

    def stop():
        host.ns += 1000 * NS_PER_MS
        for at_ms in range(0, 200, 5):
            host.live.add([needle(at_ms), cautery(at_ms)])

    host.at(5, stop)
    steps = host.run(1400)
    for _, step in steps:
        if step.decision.stamp is not None and step.decision.state is not MarginState.UNKNOWN:
            assert step.decision.stamp.ns >= 1050 * NS_PER_MS
    assert steps[-1][1].decision.state is MarginState.NEGATIVE


def test_samples_of_a_refused_playback_do_not_train_the_clock():
    """A recording whose stamps are 10 s ahead is played while the tracker goes on."""
    playing = [False]
    host = SimulatedHost(playback=PlaybackRule(lambda: "a recording" if playing[0] else ""))
    track(host, 0, 2000)
    for at_ms in range(500, 1000, 20):
        host.arrive(at_ms + 5, needle(at_ms + 10_000), cautery(at_ms + 10_000, 30.0))
    host.at(490, lambda: playing.__setitem__(0, True))
    host.at(1000, lambda: playing.__setitem__(0, False))
    steps = host.run(2000)
    during = [step for at_ms, step in steps if 520 < at_ms < 1000]
    assert len(during) > 5
    assert {step.decision.state for step in during} == {MarginState.UNKNOWN}
    assert steps[-1][1].decision.state is MarginState.NEGATIVE
    assert steps[-1][1].frame.stamp.ns < 2100 * NS_PER_MS
    left_out = host.live.left_out()
    assert left_out["samples during a refused playback"] >= 50
    assert "times that the source's clock was set back" not in left_out


def test_poses_of_a_structure_are_used_from_when_it_is_added():
    host = tracked(0, 1000)
    for at_ms in range(0, 1000, 20):
        host.arrive(at_ms + 3.1, sample("tracker", "clip", (0.0, 0.0, 0.001 * at_ms), at_ms))
    ball = AnalyticSphere(1.0)
    ball.frames = ("vessel", None)
    pose = Transform("clip", "vessel", np.eye(3), [0.0, 50.0, 0.0])

    def add():
        with host.live.between_steps() as session:
            structures = (Structure(pose, ball, 1.0, 3.0),)
            assert not session.use(replace(session.setup, structures=structures))

    host.at(500, add)
    steps = host.run(990)
    assert host.live.edges == (("tracker", "cautery"), ("tracker", "clip"), ("tracker", "needle"))
    before = [step for at, step in steps if 100 < at < 500]
    after = [step for at, step in steps if at > 560]
    assert {len(step.frame.poses) for step in before if step.frame.poses} == {2}
    assert {len(step.structures) for step in after} == {2}
    for step in (*before, *after):
        assert step.decision.state is MarginState.NEGATIVE
        assert not step.decision.hold
    assert host.live.left_out()
