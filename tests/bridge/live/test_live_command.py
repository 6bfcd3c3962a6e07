"""``marginguard live`` as a child process, with a tracker in another, heard by a third."""

import json
import signal
from pathlib import Path

import pytest

from app.case import open_case
from app.session import Session, setup_from_case

CALLER = Path(__file__).resolve().parents[1] / "caller.py"
SENDER = Path(__file__).resolve().parent / "sender.py"

CONSTRAINT = "/marginguard/constraint:marginguard_msgs/msg/FixtureConstraint"
REARM = "/marginguard/rearm:marginguard_msgs/srv/Rearm"
UNKNOWN = 3
TRACKED = {"tracked_transforms": {}, "clock": "host"}
TF = {"tf": {}, "clock": "host"}


def ns(time):
    return time["sec"] * 10**9 + time["nanosec"]


@pytest.fixture
def distances(breach, project_root):
    """Acquisition stamp to signed distance in m, as a replay of the same frames finds them."""
    session = Session(setup_from_case(open_case(project_root / "data" / "recorded_case")))
    steps = [session.step(frame) for frame in breach]
    return {
        step.decision.stamp.ns: step.decision.proximity.signed_distance_mm / 1000.0
        for step in steps
    }


@pytest.mark.parametrize(("source", "kind"), [(TRACKED, "tracked"), (TF, "tf")])
def test_live_finds_the_distances_that_a_replay_finds(
    start, start_receiver, live_yaml, frames_file, distances, source, kind
):
    live = start("-m", "app.cli", "live", "--config", str(live_yaml(source)))
    live.line(lambda line: line.startswith("UNKNOWN"))  # published before anything is tracked
    receiver = start_receiver(f"{CONSTRAINT}:1000000")
    sender = start(str(SENDER), str(frames_file), kind)
    shift_ns = int(sender.line(lambda line: line.startswith("shift")).split()[1])
    live.line(lambda line: line.startswith("POSITIVE"))
    sender.line(lambda line: line == "sent\n")
    found = {}
    last_ns = max(distances)
    while True:
        message = receiver.take(1)[0]["message"]
        if message["state"] != UNKNOWN:
            found[ns(message["header"]["stamp"]) - shift_ns] = message["signed_distance"]
        if last_ns in found or (message["state"] == UNKNOWN and len(found) > 10):
            break
    assert live.end(signal.SIGINT) == 130
    assert "Traceback" not in live.log.read_text()
    assert len(found) >= 0.5 * len(distances)
    assert min(found.values()) < 0.0 < max(found.values())
    for stamp_ns, distance in found.items():
        # A source's rotation comes as a quaternion, and a step is a bound of its own of 0.005 mm.
        assert distance == pytest.approx(distances[stamp_ns], abs=1e-5, rel=2e-3), stamp_ns


def next_constraint(receiver, wanted):
    while True:
        message = receiver.take(1)[0]["message"]
        if wanted(message):
            return message


def test_a_tracker_that_dies_is_stale_and_stays_held_until_somebody_rearms(
    start, start_receiver, live_yaml, frames_file
):
    live = start("-m", "app.cli", "live", "--config", str(live_yaml(TRACKED)))
    live.line(lambda line: line.startswith("UNKNOWN"))
    receiver = start_receiver(f"{CONSTRAINT}:1000000")
    sender = start(str(SENDER), str(frames_file), "tracked")
    seen = next_constraint(receiver, lambda message: message["state"] != UNKNOWN)
    assert seen["hold"] is False
    sender.end(signal.SIGKILL)

    stale = next_constraint(receiver, lambda message: message["state"] == UNKNOWN)
    assert "stale" in stale["reasons"]
    assert stale["hold"] is True
    beats = [message["message"] for message in receiver.take(30)]
    assert [beat["seq"] for beat in beats] == [*range(beats[0]["seq"], beats[0]["seq"] + 30)]
    assert all("stale" in beat["reasons"] for beat in beats)
    # Its planes do not look newer than they are.
    assert {ns(beat["header"]["stamp"]) for beat in beats} == {ns(stale["header"]["stamp"])}

    start(str(SENDER), str(frames_file), "tracked", "again")
    held = next_constraint(receiver, lambda message: message["state"] != UNKNOWN)
    assert held["hold"] is True
    assert "latched" in held["reasons"]
    caller = start(str(CALLER), *(f"{REARM}:{json.dumps({'seq': m['seq']})}" for m in (seen, held)))
    caller.line()
    refused = json.loads(caller.line())
    assert refused["success"] is False
    assert str(stale["seq"]) in refused["message"]
    assert json.loads(caller.line()) == {"success": True, "message": ""}
    free = next_constraint(receiver, lambda message: not message["hold"])
    assert "latched" not in free["reasons"]

    # In the middle of it all, with messages in flight both ways.
    assert live.end(signal.SIGTERM) == 143
    assert "Traceback" not in live.log.read_text()
