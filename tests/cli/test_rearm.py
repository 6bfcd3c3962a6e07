"""``marginguard rearm``: its text, and its exit status without a guard and without a terminal."""

import io
import math

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from builtin_interfaces.msg import Time
from marginguard_msgs.msg import FixtureConstraint

from app.cli.commands import rearm
from app.cli.main import main
from tests.ros_domain import domain_id as domain_id


def test_without_guard_the_exit_status_is_2(domain_id, monkeypatch, capsys):
    monkeypatch.setattr(rearm, "TIMEOUT_S", 0.2)
    assert main(["rearm", "--yes", "--namespace", "left"]) == 2
    error = capsys.readouterr().err
    assert "/left/marginguard/constraint: no constraint within 0.2 s; expected" in error


def test_without_terminal_the_operator_has_to_say_yes(monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", io.StringIO("y\n"))
    assert main(["rearm"]) == 2
    assert "standard input is not a terminal" in capsys.readouterr().err


def test_text_names_state_reasons_begin_and_ids():
    held = FixtureConstraint(
        state=FixtureConstraint.WARNING,
        hold=True,
        reasons=["warning_distance", "latched"],
        hold_since=Time(sec=1000),
        signed_distance=0.0042,
        model_id="sha256:1",
        instance_id="00ff",
        seq=7,
        rearm_nonce=9,
    )
    lines = rearm.hold_text(held, "/marginguard/constraint", 1041.2).splitlines()
    assert lines[0] == "/marginguard/constraint: WARNING, on hold"
    rows = {line[2:17].strip(): line[17:] for line in lines[1:]}
    assert rows["reasons"] == "warning_distance, latched"
    assert rows["on hold since"].endswith("(41 s)")
    assert rows["distance"] == "4.20 mm"
    assert (rows["tumour"], rows["registration"], rows["guard"]) == ("sha256:1", "none", "00ff")
    assert rows["seq, nonce"] == "7, 9"


def test_unknown_distance_is_no_number_in_the_text():
    unknown = FixtureConstraint(
        state=FixtureConstraint.UNKNOWN, hold=True, reasons=["silent"], signed_distance=math.nan
    )
    text = rearm.hold_text(unknown, "/c", 1.0)
    assert text.startswith("/c: UNKNOWN, on hold\n")
    assert "  distance       unknown\n" in text
    assert "nan" not in text


def test_text_of_a_free_guard_is_one_line():
    free = FixtureConstraint(state=FixtureConstraint.NEGATIVE)
    assert rearm.hold_text(free, "/c", 0.0) == "/c: NEGATIVE, not on hold"
