"""Said once a second of the player's time and at every change; lost poses are counted."""

from dataclasses import replace

import pytest

from app.bridge.diagnostics import Diagnostics
from app.fixture import MarginState


def parts(report):
    return {status.name.removeprefix("marginguard: "): status for status in report.status}


def values(status):
    return {value.key: value.value for value in status.values}


def test_a_second_passes_between_reports_of_the_same(make_step):
    diagnostics = Diagnostics()
    spoken = [index for index in range(120) if diagnostics.report(make_step(index))]
    assert spoken == [0, 50, 100]


def test_a_change_and_a_seek_back_are_said_at_once(make_step):
    diagnostics = Diagnostics()
    assert diagnostics.report(make_step(10))
    assert diagnostics.report(make_step(11, lost=True))
    assert diagnostics.report(make_step(12))
    assert diagnostics.report(make_step(13)) is None
    assert diagnostics.report(make_step(3))


@pytest.mark.parametrize(
    ("state", "level"),
    [
        (MarginState.NEGATIVE, b"\x00"),
        (MarginState.WARNING, b"\x01"),
        (MarginState.POSITIVE, b"\x02"),
        (MarginState.UNKNOWN, b"\x03"),
    ],
)
def test_the_level_follows_the_state(make_step, state, level):
    report = Diagnostics().report(make_step(0, state=state))
    assert parts(report)["margin"].level == level


def test_ages_and_distances_are_said(make_step):
    report = parts(Diagnostics().report(make_step(0)))
    margin = values(report["margin"])
    assert margin["signed_distance_mm"] == "7.500"
    assert margin["applied_stop_mm"] == "1.750"
    assert margin["age_ms"] == "3.0"
    assert values(report["tracking"])["reference -> needle: age_ms"] == "3.0"
    assert values(report["joints"]) == {"age_ms": "5.0"}


def test_lost_poses_are_named_and_counted(make_step):
    diagnostics = Diagnostics()
    diagnostics.report(make_step(0, lost=True))
    diagnostics.report(make_step(1, lost=True))
    tracking = parts(diagnostics.report(make_step(2)))["tracking"]
    assert tracking.message == "all tracked"
    assert values(tracking)["tracker -> cautery: lost samples"] == "2"
    tracking = parts(diagnostics.report(make_step(3, lost=True)))["tracking"]
    assert tracking.message == "lost: tracker -> cautery"
    assert tracking.level == b"\x01"
    assert values(tracking)["tracker -> cautery: status"] == "INVALID"


def test_a_robot_whose_joints_cannot_be_used_is_said_at_once_and_why(make_step):
    diagnostics = Diagnostics()
    diagnostics.report(make_step(0))
    silent = [
        replace(make_step(index), robot_problem=f"joint positions are {index} ms old")
        for index in (1, 2)
    ]
    joints = parts(diagnostics.report(silent[0]))["joints"]
    assert joints.message == "joint positions are 1 ms old"
    assert joints.level == b"\x01"
    assert diagnostics.report(silent[1]) is None
    assert parts(diagnostics.report(make_step(3)))["joints"].level == b"\x00"


def test_a_robot_that_never_spoke_is_said_too(make_step):
    never = replace(make_step(0), joints=None, robot_problem="no joint positions yet")
    joints = parts(Diagnostics().report(never))["joints"]
    assert (joints.message, values(joints)) == ("no joint positions yet", {})
