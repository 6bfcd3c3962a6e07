"""A live session that follows the whole recording, 150 s, compared with a replay."""

from itertools import pairwise

import pytest

from app.case import open_case
from app.fixture import MarginState, Reason
from app.geometry import NS_PER_S
from app.runtime import ReplayRun, prepare_case
from tests.python_process import run_python

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]

CONSTRAINT = "/marginguard/constraint"
TRACKED = "/tracked_transforms"
TOPICS = (
    f"{CONSTRAINT}:marginguard_msgs/msg/FixtureConstraint:1000000",
    f"{TRACKED}:marginguard_msgs/msg/TrackedTransform:1000000",
)
SOURCE = {"tracked_transforms": {}, "clock": "host"}
FIRST_NS = 1000 * NS_PER_S
"""Stamp of the first frame of the recorded case."""

FRAME_NS = NS_PER_S // 40
MIN_DROPOUT_S = 0.2
FRAMES = ("reference", "needle", "cautery")
LONG_DROPOUTS = {
    *(("invalid", frame) for frame in ("cautery", "reference")),
    *(("missing", frame) for frame in FRAMES),
}

POSITIVE, UNKNOWN = int(MarginState.POSITIVE), int(MarginState.UNKNOWN)


@pytest.fixture(scope="session")
def recorded(project_root):
    """Stamp in ns of each valid pose of the tool, by its numbers in a message.

    Poses that the tracker repeats are left out: their numbers do not tell the stamp.
    """
    stamps, repeated = {}, set()
    for frame in open_case(project_root / "data" / "recorded_case").recorded_frames():
        for sample in frame.poses:
            if sample.source == "cautery" and sample.transform is not None:
                position_m = sample.transform.translation_mm / 1000.0
                values = numbers(position_m, sample.transform.quaternion_xyzw)
                if stamps.setdefault(values, sample.stamp.ns) != sample.stamp.ns:
                    repeated.add(values)
    assert len(repeated) < 0.1 * len(stamps)
    return {values: stamp_ns for values, stamp_ns in stamps.items() if values not in repeated}


@pytest.fixture(scope="session")
def replayed(project_root):
    """Decisions of a replay by the stamp of the oldest pose in use, as listed in ``margin.csv``."""
    prepared = prepare_case(project_root / "data" / "recorded_case")
    run = ReplayRun(prepared, clock_ns=lambda: 0)
    decisions = [step.decision for step in run.steps()]
    return {each.stamp.ns: each for each in decisions if each.proximity is not None}


def numbers(position_m, quaternion):
    return tuple(round(float(value), 9) for value in (*position_m, *quaternion))


def ns(time):
    return time["sec"] * NS_PER_S + time["nanosec"]


def shifts_of(messages, recorded):
    """Moved minus recorded stamp of each valid sample of the tool whose pose is not repeated."""
    for message in messages:
        move, turn = message["transform"]["translation"], message["transform"]["rotation"]
        values = numbers([move[axis] for axis in "xyz"], [turn[axis] for axis in "xyzw"])
        if message["status"] == 0 and values in recorded:
            yield ns(message["header"]["stamp"]) - recorded[values]


class Received:
    """Constraints and samples of the tool in the order of receipt."""

    def __init__(self, receiver):
        self._receiver = receiver
        self.constraints = []
        self.samples = []

    def until(self, accept):
        """Receive up to and including the first constraint that ``accept`` accepts; return it."""
        while True:
            (line,) = self._receiver.take(1)
            message = line["message"]
            if line["topic"] == CONSTRAINT:
                self.constraints.append(message)
                if accept(message):
                    return message
            elif message["child_frame_id"] == "cautery":
                self.samples.append(message)


def check_samples(samples, recorded):
    """Every recorded pose of the tool arrives, with the recorded intervals; returns the shift."""
    valid = [message for message in samples if message["status"] == 0]
    (shift_ns,) = set(shifts_of(valid, recorded))
    played = {ns(message["header"]["stamp"]) - shift_ns for message in valid}
    # The receiver may have discovered the playback after its first samples.
    assert played >= {stamp_ns for stamp_ns in recorded.values() if stamp_ns >= min(played)}
    assert min(played) < min(recorded.values()) + 10 * NS_PER_S
    return shift_ns


def check_dropouts(constraints, shift_ns, case):
    """In each dropout the state is UNKNOWN, and no constraint is based on its samples.

    A session steps with the newest samples, so it may never see a single lost one.
    """
    states = [(m["state"], ns(m["header"]["stamp"]) - shift_ns) for m in constraints]
    dropouts = open_case(case).expected().dropouts
    long = [each for each in dropouts if each.end_s - each.start_s > MIN_DROPOUT_S]
    assert {(each.kind, each.frame) for each in long} == LONG_DROPOUTS
    for dropout in long:
        # The pose at the start of some dropouts is the last one that the tracker has sent; sample
        # times are irregular.
        start_ns = FIRST_NS + round(dropout.start_s * NS_PER_S) + 2 * FRAME_NS
        end_ns = FIRST_NS + round(dropout.end_s * NS_PER_S) - 2 * FRAME_NS
        known = [stamp_ns for state, stamp_ns in states if state != UNKNOWN]
        assert not [stamp_ns for stamp_ns in known if start_ns <= stamp_ns < end_ns], dropout
        before = max(stamp_ns for stamp_ns in known if stamp_ns < start_ns)
        after = min(stamp_ns for stamp_ns in known if stamp_ns >= end_ns)
        between = states[states_index(states, before) : states_index(states, after)]
        assert UNKNOWN in {state for state, _ in between}, dropout


def states_index(states, stamp_ns):
    """Index of the first known constraint with this stamp."""
    return next(i for i, (state, ns_) in enumerate(states) if ns_ == stamp_ns and state != UNKNOWN)


def check_constraints(constraints, shift_ns, replayed):
    """Distance and state of each constraint are those of the replay at its stamp.

    A sample that arrives after its frame was stepped makes another pair than in the replay; the
    tool has then moved by one step at most (2 mm). All others differ by the tolerance of a
    distance, 0.005 mm + 0.2 %, which depends on the queries before it. The applied warning distance
    grows with the age of the data, 0 in a replay, so it is taken from the constraint.
    """
    known = {
        ns(message["header"]["stamp"]) - shift_ns: message
        for message in reversed(constraints)
        if message["state"] != UNKNOWN
    }
    assert len(known) > 500  # of about 3500: on a busy machine one step skips several frames
    exact = 0
    for stamp_ns, message in known.items():
        expected = replayed[stamp_ns]
        expected_mm = expected.proximity.signed_distance_mm
        found_mm = 1000.0 * message["signed_distance"]
        assert found_mm == pytest.approx(expected_mm, abs=2.0), stamp_ns
        if found_mm != pytest.approx(expected_mm, abs=0.01, rel=2e-3):
            continue
        exact += 1
        # Both count steps, of which a live session may take two for a stamp.
        if {Reason.RELEASING, Reason.RECOVERING} & {*message["reasons"], *expected.reasons}:
            continue
        if message["state"] == POSITIVE or expected.state is MarginState.POSITIVE:
            assert expected_mm < 0.01
        elif message["state"] == MarginState.NEGATIVE:
            assert expected_mm > 1000.0 * message["warn_distance"] - 0.02
        else:
            assert expected_mm < 1000.0 * message["warn_distance"] + 0.02
    assert exact >= 0.8 * len(known)
    assert {message["state"] for message in known.values()} == {0, 1, 2}


def breaches_of(constraints):
    """Number of times that the state becomes POSITIVE."""
    known = [message["state"] for message in constraints if message["state"] != UNKNOWN]
    return sum(now == POSITIVE != before for before, now in pairwise(known))


def test_session_decides_on_a_playback_as_on_a_replay_and_can_be_rearmed(
    start, tracker, live_yaml, start_receiver, recorded, replayed, project_root, tmp_path
):
    config = str(live_yaml(SOURCE))
    case = tmp_path / "case"
    recorder = start("-m", "app.cli", "record", "-o", str(case), "--config", config)
    session = start("-m", "app.cli", "live", "--constraint-hz", "50", "--config", config)
    session.line(lambda line: line.startswith("UNKNOWN"))
    player = tracker()
    received = Received(start_receiver(*TOPICS))
    received.until(lambda message: message["state"] != UNKNOWN)
    shift_ns = next(shifts_of(received.samples, recorded))

    def is_after(message, seconds):
        return ns(message["header"]["stamp"]) - shift_ns > FIRST_NS + seconds * NS_PER_S

    held = received.until(lambda m: m["state"] != UNKNOWN and is_after(m, 22.7))
    assert held["hold"]
    assert "latched" in held["reasons"]
    while start("-m", "app.cli", "rearm", "--yes").wait() != 0:  # it is refused while UNKNOWN
        received.until(lambda message: message["state"] != UNKNOWN)
    received.until(lambda message: not message["hold"])
    for reached_s in (60.0, 100.0, 140.0):
        received.until(lambda m, s=reached_s: m["state"] != UNKNOWN and is_after(m, s))
    received.until(lambda m: m["state"] == UNKNOWN and player.process.poll() is not None)
    assert player.wait() == 0

    assert check_samples(received.samples, recorded) == shift_ns
    check_constraints(received.constraints, shift_ns, replayed)
    check_dropouts(received.constraints, shift_ns, project_root / "data" / "recorded_case")
    assert breaches_of(received.constraints) == 3
    assert session.line(lambda line: line.startswith("POSITIVE")).endswith(" [PLAYBACK]")
    for child in (session, recorder):
        child.stop()
    assert "PLAYBACK: poses from a recording, simulated lumpectomy 1" in session.log.read_text()
    check_recording(case)


def check_recording(case):
    """The recording is a case with a breach; it holds the announcement of the playback."""
    done = run_python("-m", "app.cli", "replay", case, "--no-ros")
    assert "breach 3" in done.stdout
    assert b"/marginguard_tracker/playback" in (case / "tracking" / "tracking_0.mcap").read_bytes()
