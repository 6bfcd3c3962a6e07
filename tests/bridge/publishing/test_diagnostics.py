"""Diagnostics: published every second of the player's time and at every change."""

from dataclasses import replace

import pytest

from app.bridge.publishing.diagnostics import Diagnostics
from app.case import TrackingFrame
from app.fixture import MarginState, Reason
from app.session import ToolDistance

pytestmark = pytest.mark.slow

STALE_NS = 200_000_000


def parts(report):
    return {status.name.removeprefix("marginguard: "): status for status in report.status}


def values(status):
    return {value.key: value.value for value in status.values}


def test_unchanged_report_is_repeated_after_a_second(make_step):
    diagnostics = Diagnostics()
    reported = [index for index in range(120) if diagnostics.report(make_step(index), STALE_NS)]
    assert reported == [0, 50, 100]


def test_change_and_seek_back_are_reported_at_once(make_step):
    diagnostics = Diagnostics()
    assert diagnostics.report(make_step(10), STALE_NS)
    assert diagnostics.report(make_step(11, lost=True), STALE_NS)
    assert diagnostics.report(make_step(12), STALE_NS)
    assert diagnostics.report(make_step(13), STALE_NS) is None
    assert diagnostics.report(make_step(3), STALE_NS)


@pytest.mark.parametrize(
    ("state", "level"),
    [
        (MarginState.NEGATIVE, b"\x00"),
        (MarginState.WARNING, b"\x01"),
        (MarginState.POSITIVE, b"\x02"),
        (MarginState.UNKNOWN, b"\x03"),
    ],
)
def test_level_follows_the_state(make_step, state, level):
    report = Diagnostics().report(make_step(0, state=state), STALE_NS)
    assert parts(report)["margin"].level == level


def test_counts_of_the_sources_are_reported_with_a_playback(make_step):
    step = make_step(0)
    of_source = parts(Diagnostics(lambda: {"refused": 3}).report(step, STALE_NS))["source"]
    assert (of_source.level, values(of_source)) == (b"\x00", {"refused": "3"})
    played = replace(step, playback="poses from a recording")
    of_source = parts(Diagnostics(lambda: {"refused": 4}).report(played, STALE_NS))["source"]
    assert (of_source.level, values(of_source)) == (b"\x01", {"refused": "4"})
    assert of_source.message == "PLAYBACK: poses from a recording"
    assert "source" not in parts(Diagnostics().report(step, STALE_NS))


def test_ages_and_distances_are_reported(make_step):
    report = parts(Diagnostics().report(make_step(0), STALE_NS))
    margin = values(report["margin"])
    assert margin["signed_distance_mm"] == "7.500"
    assert margin["applied_stop_mm"] == "1.750"
    assert margin["age_ms"] == "3.0"
    assert values(report["tracking"])["reference -> needle: age_ms"] == "3.0"
    assert values(report["joints"]) == {"age_ms": "5.0"}


def test_lost_poses_are_named_and_counted(make_step):
    diagnostics = Diagnostics()
    diagnostics.report(make_step(0, lost=True), STALE_NS)
    diagnostics.report(make_step(1, lost=True), STALE_NS)
    tracking = parts(diagnostics.report(make_step(2), STALE_NS))["tracking"]
    assert tracking.message == "all tracked"
    assert values(tracking)["tracker -> cautery: lost samples"] == "2"
    tracking = parts(diagnostics.report(make_step(3, lost=True), STALE_NS))["tracking"]
    assert tracking.message == "lost: tracker -> cautery"
    assert tracking.level == b"\x01"
    assert values(tracking)["tracker -> cautery: status"] == "INVALID"


def test_unusable_joint_states_are_reported_at_once_with_the_reason(make_step):
    diagnostics = Diagnostics()
    diagnostics.report(make_step(0), STALE_NS)
    silent = [
        replace(make_step(index), robot_problem=f"joint positions are {index} ms old")
        for index in (1, 2)
    ]
    joints = parts(diagnostics.report(silent[0], STALE_NS))["joints"]
    assert joints.message == "joint positions are 1 ms old"
    assert joints.level == b"\x01"
    assert diagnostics.report(silent[1], STALE_NS) is None
    assert parts(diagnostics.report(make_step(3), STALE_NS))["joints"].level == b"\x00"


def test_missing_joint_states_are_reported(make_step):
    never = replace(make_step(0), joints=None, robot_problem="no joint positions yet")
    joints = parts(Diagnostics().report(never, STALE_NS))["joints"]
    assert (joints.message, values(joints)) == ("no joint positions yet", {})


def test_problem_of_the_frames_is_reported_at_once(make_step):
    diagnostics = Diagnostics()
    diagnostics.report(make_step(0), STALE_NS)
    wrong = replace(make_step(1, lost=True), frames_problems=("tumor.frame is 'needel': not sent",))
    tracking = parts(diagnostics.report(wrong, STALE_NS))["tracking"]
    assert tracking.message == "tumor.frame is 'needel': not sent; lost: tracker -> cautery"
    assert tracking.level == b"\x01"
    named = replace(make_step(2, lost=True), frames_problems=())
    assert parts(diagnostics.report(named, STALE_NS))["tracking"].message.startswith("lost:")
    again = replace(make_step(3, lost=True), frames_problems=("tumor.frame is 'needel': not sent",))
    assert diagnostics.report(again, STALE_NS) is not None


def test_silent_tracker_is_reported_as_stale(make_step):
    """tf cannot represent a lost pose, so the last sample stays OK and becomes old."""
    diagnostics = Diagnostics()
    diagnostics.report(make_step(0), STALE_NS)
    silent = replace(make_step(60, lost=True), frame=TrackingFrame(make_step(60).frame.stamp, ()))
    tracking = parts(diagnostics.report(silent, STALE_NS))["tracking"]
    assert tracking.level == b"\x03"
    assert tracking.message == "stale: tracker -> cautery, reference -> needle"
    assert values(tracking)["tracker -> cautery: status"] == "OK"
    tracking = parts(diagnostics.report(make_step(120, lost=True), STALE_NS))["tracking"]
    assert (tracking.level, tracking.message) == (b"\x01", "lost: tracker -> cautery")


def test_no_samples_are_reported_as_not_tracked(make_step):
    silent = replace(make_step(0, lost=True), frame=TrackingFrame(make_step(0).frame.stamp, ()))
    tracking = parts(Diagnostics().report(silent, STALE_NS))["tracking"]
    assert (tracking.level, tracking.message) == (b"\x03", "nothing was tracked so far")


def test_warning_of_another_tool_has_a_status_of_its_own(make_step):
    def report(state, *reasons):
        tool = ToolDistance("left", state, reasons)
        return diagnostics.report(replace(make_step(0), tools=(tool,)), STALE_NS)

    diagnostics = Diagnostics()
    tools = parts(report(MarginState.UNKNOWN, Reason.STALE))["tools"]
    assert tools.level == b"\x01"
    assert tools.message == "distance of tool 'left' is not known (stale)"
    found = parts(report(MarginState.NEGATIVE, Reason.CLEAR))
    assert found["tools"].level == b"\x00"
    assert found["margin"].level == b"\x00"
    assert report(MarginState.NEGATIVE, Reason.CLEAR) is None
