"""The depth of a breach between frames: estimate, bound and time in the summary and the page."""

import re

import numpy as np
import pytest
import trimesh

from app.analysis import find_breaches
from app.fixture import TipProximity
from app.geometry import Stamp, SurfaceMesh, TrackedTransform, TrackingStatus, Transform
from app.report import ReplayLog, ReplayRecord, summarise
from app.report.record import breach_depths
from app.report.write import report_html
from app.runtime import StepTiming
from app.session import Session, SessionSetup
from tests.doubles import PARAMETERS, frame

RADIUS_MM = 10.0


@pytest.fixture(scope="module")
def ball():
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=RADIUS_MM)
    return TipProximity(SurfaceMesh("tumor", mesh.vertices, mesh.faces))


def summary_of(ball, x_mm, y_mm):
    """Summary of frames 20 ms apart with the tip at these x; None is a frame without the tool."""
    setup = SessionSetup(
        Transform.identity("cautery", "cautery_tip"),
        Transform.identity("reference", "tumor"),
        ball,
        PARAMETERS,
        None,
    )
    session, log = Session(setup), ReplayLog()
    for index, x in enumerate(x_mm):
        stamp = Stamp(index * 20_000_000)
        pose = Transform("reference", "cautery", np.eye(3), [x or 0.0, y_mm, 0.0])
        sample = (
            TrackedTransform.lost("reference", "cautery", stamp, TrackingStatus.INVALID)
            if x is None
            else TrackedTransform(pose, stamp, TrackingStatus.OK)
        )
        log.publish(session.step(frame(index * 20, sample)), StepTiming(duration_ns=1))
    breaches = find_breaches(log.rows, PARAMETERS.stale_after_ns)
    depths = breach_depths(log.tumor.paths, breaches, ball, PARAMETERS.stale_after_ns)
    return summarise(ReplayRecord("a pass", {}, tuple(log.rows), PARAMETERS, depths=depths))


def test_breach_between_two_frames_is_marked(ball):
    summary = summary_of(ball, [-30.0, -14.0, 14.0, 30.0], 6.0)
    (breach,) = summary["breaches"]
    assert breach["between_frames"] is True
    assert breach["path_min_signed_distance_mm"] == pytest.approx(-4.0, abs=0.05)
    assert breach["path_lower_bound_mm"] <= -3.98
    assert breach["path_lower_bound_mm"] == pytest.approx(-4.0, abs=0.06)
    assert breach["deepest_s"] == pytest.approx(0.03, abs=0.001)


def test_frames_inside_understate_the_depth_of_the_path(ball):
    summary = summary_of(ball, [-20.0, -7.0, 7.0, 20.0], 4.0)
    (breach,) = summary["breaches"]
    in_frames_mm = np.hypot(7.0, 4.0) - RADIUS_MM
    assert breach["between_frames"] is False
    assert breach["min_signed_distance_mm"] == pytest.approx(in_frames_mm, abs=0.05)
    assert breach["path_min_signed_distance_mm"] == pytest.approx(-6.0, abs=0.05)
    assert breach["deepest_s"] == pytest.approx(0.03, abs=0.001)
    assert summary["path_min_signed_distance_mm"] == breach["path_min_signed_distance_mm"]
    page = report_html(summary, (), b"", None, "1")
    assert re.search(r"<b>-[56]\.\d\d mm</b>smallest signed distance", page)
    assert '<td class="number">in frames</td>' in page


def test_entry_is_part_of_the_path_and_a_long_gap_is_not(ball):
    """The frame before the breach is outside; the path from there is deeper than both frames."""
    entry = summary_of(ball, [-9.9, 9.0, 9.0], 2.0)
    assert entry["breaches"][0]["path_min_signed_distance_mm"] == pytest.approx(-8.0, abs=0.05)
    gap = summary_of(ball, [-9.9, *[None] * 15, 9.0, 9.0], 2.0)
    (breach,) = gap["breaches"]
    assert breach["path_min_signed_distance_mm"] == breach["min_signed_distance_mm"]
    assert breach["min_signed_distance_mm"] > -1.0


def test_replay_without_a_breach_has_no_depth(ball):
    summary = summary_of(ball, [-30.0, -29.0], 6.0)
    assert summary["breaches"] == []
    assert summary["path_min_signed_distance_mm"] is None
