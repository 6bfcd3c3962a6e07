"""A live session while a recording is played on its graph."""

from app.fixture import MarginState, Reason
from app.geometry import NS_PER_MS
from app.session import PlaybackRule
from tests.session.test_live import HOST_MS, SimulatedHost, track


def run_with_playback(from_ms, to_ms, *, accepted, until_ms=600):
    """(time in ms, step) of a session with a playback between the given times."""
    host = SimulatedHost(
        playback=PlaybackRule(
            lambda: "a recording" if from_ms <= host.ns / NS_PER_MS - HOST_MS < to_ms else "",
            accepted=accepted,
        )
    )
    track(host, 0, until_ms)
    return host.run(until_ms)


def test_accepted_playback_is_named_in_every_step_and_changes_no_state():
    steps = run_with_playback(200, 400, accepted=True)
    for at_ms, step in steps:
        assert step.playback == ("a recording" if 200 <= at_ms < 400 else "")
        assert step.frames_problem == ""
        if at_ms > 150:
            assert step.decision.state is MarginState.NEGATIVE


def test_refused_playback_makes_the_next_step_unknown_and_uses_no_pose():
    steps = run_with_playback(200, 400, accepted=False)
    during = [step for at_ms, step in steps if 200 <= at_ms < 400]
    assert len(during) > 5
    for step in during:
        assert step.decision.state is MarginState.UNKNOWN
        assert Reason.INVALID in step.decision.reasons
        assert step.decision.hold
        assert step.tumor_from_tip is None
        assert [sample.transform for sample in step.frame.poses if sample.transform] == []
        assert step.frame.joints == ()
        assert step.playback == "a recording"
        assert step.frames_problem == (
            "PLAYBACK refused: a recording; expected provenance.kind 'simulated' in live.yaml"
        )


def test_hold_stays_after_a_refused_playback():
    _, last = run_with_playback(200, 400, accepted=False)[-1]
    assert last.decision.state is MarginState.NEGATIVE
    assert last.decision.hold
    assert Reason.LATCHED in last.decision.reasons
    assert last.frames_problem == last.playback == ""


def test_playback_before_the_first_sample_is_refused():
    (_, first), *_ = run_with_playback(0, 10_000, accepted=False)
    assert first.playback == "a recording"
    assert first.frames_problem.startswith("PLAYBACK refused")
    assert Reason.INVALID in first.decision.reasons
