from dataclasses import replace

import numpy as np
import pytest

from app.analysis import find_breaches
from app.case import (
    Expected,
    ExpectedBreach,
    ExpectedBreaches,
    ExpectedDropout,
    ExpectedRegistration,
)
from app.geometry import Transform
from app.registration import given_registration
from app.report import check_expected

STALE_NS = 200_000_000


def run(expected, rows, registration=None):
    checks = check_expected(expected, rows, find_breaches(rows, STALE_NS), registration, STALE_NS)
    assert len({check.name for check in checks}) == len(checks)
    return {check.name: check for check in checks}


def breaches(*intervals):
    return Expected(
        breaches=ExpectedBreaches(40.0, 0.3, tuple(ExpectedBreach(*one) for one in intervals))
    )


def results(checks):
    return {name: check.result for name, check in checks.items()}


def test_nothing_expected_gives_no_checks(rows_of):
    assert run(Expected(), rows_of([1.0])) == {}


@pytest.mark.parametrize(("frames", "result"), [(2, "pass"), (3, "fail")])
def test_frames(rows_of, frames, result):
    assert run(Expected(frames=frames), rows_of([1.0, 1.0]))["frames"].result == result


def test_breaches_within_tolerance(rows_of):
    rows = rows_of([1.0, 1.0, 1.0, -1.0, -2.0, -1.0, 1.0])  # inside from 60 to 100 ms
    assert results(run(breaches((0.02, 0.14, -2.3)), rows)) == {
        "breach 1": "pass",
        "depth of breach 1": "pass",
        "no false breach": "pass",
    }


@pytest.mark.parametrize("interval", [(0.019, 0.10, -2.0), (0.06, 0.141, -2.0)])
def test_breach_out_of_tolerance_is_missed_and_false(rows_of, interval):
    rows = rows_of([1.0, 1.0, 1.0, -1.0, -2.0, -1.0, 1.0])
    checks = run(breaches(interval), rows)
    assert results(checks) == {"breach 1": "fail", "no false breach": "fail"}
    assert "0.060 s to 0.100 s" in checks["no false breach"].detail
    assert "nearest is 0.060 s" in checks["breach 1"].detail


def test_wrong_depth(rows_of):
    checks = run(breaches((0.0, 0.0, -1.31)), rows_of([-1.0, 1.0]))
    assert checks["breach 1"].passed
    assert not checks["depth of breach 1"].passed


def test_one_breach_is_not_found_twice(rows_of):
    checks = run(breaches((0.0, 0.02, -1.0), (0.0, 0.02, -1.0)), rows_of([-1.0, -1.0, 1.0]))
    assert results(checks)["breach 1"] == "pass"
    assert results(checks)["breach 2"] == "fail"


def test_false_breach_where_none_is_expected(rows_of):
    assert results(run(breaches(), rows_of([1.0, -1.0]))) == {"no false breach": "fail"}


def test_registration_within_and_beyond(rows_of):
    truth = Transform.from_rotation_vector(
        [0.1, 0.2, 0.3], [10.0, 20.0, 30.0], target="reference", source="robot_base"
    )
    off = Transform.from_rotation_vector(
        np.radians([0.4, 0.0, 0.0]), [0.9, 0.0, 0.0], target="reference", source="reference"
    )
    # A rotation about the base's own origin: the origin moves by 0.9 mm only.
    at_origin = Transform.identity("reference", "reference")
    centered = replace(at_origin, translation_mm=truth.translation_mm)
    found = centered @ off @ centered.inverse() @ truth
    rows = rows_of([1.0])
    for tolerance_mm, tolerance_deg, passed in (
        (1.0, 0.5, True),
        (0.8, 0.5, False),
        (1.0, 0.3, False),
    ):
        expected = Expected(registration=ExpectedRegistration(truth, tolerance_mm, tolerance_deg))
        check = run(expected, rows, given_registration(found))["registration"]
        assert check.passed is passed
        assert check.detail.startswith("0.900 mm and 0.400 deg off")


def test_registration_that_is_missing_or_refused(rows_of):
    truth = Transform.identity("reference", "robot_base")
    expected = Expected(registration=ExpectedRegistration(truth, 1.0, 0.5))
    refused = replace(given_registration(truth), accepted=False, reason="too few points")
    assert not run(expected, rows_of([1.0]))["registration"].passed
    check = run(expected, rows_of([1.0]), refused)["registration"]
    assert not check.passed
    assert "too few points" in check.detail


def dropout(rows, *values):
    expected = Expected(dropouts=(ExpectedDropout("cautery", *values),))
    return run(expected, rows)["UNKNOWN in dropout 1"]


def test_invalid_dropout_is_unknown_from_its_first_frame(rows_of):
    rows = rows_of([6.0, None, None, 6.0])
    assert dropout(rows, "invalid", 0.02, 0.04).passed
    check = dropout(rows, "invalid", 0.0, 0.04)
    assert not check.passed
    assert "1 of 3 frames" in check.detail
    assert "NEGATIVE at 0.000 s" in check.detail


def test_missing_dropout_is_unknown_once_stale(rows_of):
    # Last seen at 0 s, and known until 200 ms, which is not yet older than stale_after.
    rows = rows_of([6.0] * 11 + [None] * 5)
    assert dropout(rows, "missing", 0.0, 0.28).passed
    late = (*rows[:11], replace(rows[0], stamp_ns=rows[11].stamp_ns), *rows[12:])
    check = dropout(late, "missing", 0.0, 0.28)
    assert not check.passed
    assert "1 of 4 frames are not UNKNOWN, the first is NEGATIVE at 0.220 s" in check.detail


def test_silent_source_is_checked_by_the_last_state_before(rows_of):
    # A watchdog frame is UNKNOWN 160 ms into the silence; the next frame is at 600 ms.
    good, lost, back = rows_of([6.0, None, 6.0], period_ns=0)
    rows = (
        good,
        replace(lost, stamp_ns=good.stamp_ns + 160_000_000),
        replace(back, stamp_ns=good.stamp_ns + 600_000_000),
    )
    assert dropout(rows, "missing", 0.0, 0.58).passed
    assert not dropout((good, rows[2]), "missing", 0.0, 0.58).passed


def test_dropout_without_a_frame_fails(rows_of):
    check = dropout(rows_of([6.0] * 20), "invalid", -2.0, -1.0)
    assert not check.passed
    assert "no frame" in check.detail
