"""The committed case that the demo replays: recording, robot and truth are consistent."""

import hashlib
from collections import defaultdict

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.case import open_case
from app.geometry import NS_PER_S, TrackingStatus
from app.robot import load_robot
from app.synthetic.case_options import typical_errors
from app.synthetic.tracker_model import AURORA


@pytest.fixture(scope="module")
def case(project_root):
    return open_case(project_root / "data" / "recorded_case")


@pytest.fixture(scope="module")
def frames(case):
    return list(case.frames())


def test_recorded_case_is_small_and_declared_as_simulated(case):
    assert sum(path.stat().st_size for path in case.folder.iterdir()) < 5_000_000
    assert case.manifest.provenance.kind == "simulated"
    recording = (case.folder / case.manifest.recording.path).read_bytes()
    assert hashlib.sha256(recording).hexdigest() == case.manifest.recording.sha256


def test_recorded_case_contains_the_events_of_the_demo(case):
    tumor = case.tumor_mesh().require_closed("tumor.stl")
    assert len(tumor.faces) >= 20_000
    deep, brief, shaft = case.expected().breaches.intervals
    assert brief.end_s - brief.start_s < 0.4
    assert deep.min_signed_distance_mm < -4.0 < shaft.min_signed_distance_mm
    assert [deep.shaft_only, brief.shaft_only, shaft.shaft_only] == [False, False, True]
    assert {dropout.kind for dropout in case.expected().dropouts} == {"invalid", "missing"}


def test_recorded_case_has_the_errors_of_a_tracker(case, frames):
    """Irregular times, missing frames, repeated poses, steps of positions; a small tumour."""
    assert frames[-1].stamp.ns - frames[0].stamp.ns > 120 * NS_PER_S
    tracked = [frame for frame in frames if frame.poses]
    intervals_s = np.diff([frame.stamp.ns for frame in tracked]) / NS_PER_S
    usual_s = intervals_s[intervals_s < 1.5 * AURORA.period_s]
    spread_s = np.hypot(AURORA.period_sd_s, np.sqrt(2.0) * AURORA.stamp_sd_s)
    assert np.std(usual_s) == pytest.approx(spread_s, rel=0.1)
    assert 0.0 < np.mean(intervals_s > 1.5 * AURORA.period_s) < 0.01
    positions_mm = np.array(
        [
            sample.transform.translation_mm
            for frame in tracked
            for sample in frame.poses
            if sample.source == "cautery" and sample.transform is not None
        ]
    )
    repeated = np.mean((np.diff(positions_mm, axis=0) == 0.0).all(axis=1))
    assert repeated == pytest.approx(AURORA.repeated, rel=0.75)
    steps = positions_mm / AURORA.position_quantum_mm
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    extent_mm = np.ptp(case.tumor_mesh().vertices_mm, axis=0)
    assert extent_mm.max() < 20.0 and extent_mm.min() > 8.0


def test_the_joints_of_our_robot_follow_the_tracked_tool(case, frames):
    """Checks kinematics, clock offset, calibration and true registration together.

    The difference is jitter and what is constant in a dwell: errors of calibration and encoders,
    and distortion. Successive samples in a dwell differ by the jitter alone.
    """
    manifest, expected = case.manifest, case.expected()
    robot = load_robot(case.robot_urdf())
    dwells = manifest.registration.dwells
    held_until_s = max(dwell.end_s for dwell in dwells)
    off_mm, off_deg, turns_deg = [], [], []
    before = None
    for frame in frames:
        if frame.stamp.ns > frames[0].stamp.ns + held_until_s * NS_PER_S:
            break
        after = [s for s in frame.joints if frame.stamp.ns - s.stamp.ns < 5_000_000]
        poses = {s.source: s.transform for s in frame.poses if s.status is TrackingStatus.OK}
        if not {"reference", "cautery"} <= poses.keys():
            before = None
            continue
        links = robot.forward_kinematics(after[-1].as_mapping())
        base_from_tip = links[manifest.robot.tool_link].renamed(
            target=manifest.robot.base_frame, source=manifest.tool.tip_frame
        )
        by_arm = expected.registration.reference_from_base @ base_from_tip
        by_tracker = poses["reference"].inverse() @ poses["cautery"] @ manifest.tool.tool_from_tip
        off_mm.append(by_arm.distance_mm_to(by_tracker))
        off_deg.append(np.degrees(by_arm.angle_to(by_tracker)))
        difference = by_arm.rotation.T @ by_tracker.rotation
        seconds = (frame.stamp.ns - frames[0].stamp.ns) / NS_PER_S
        at_rest = any(dwell.start_s <= seconds <= dwell.end_s for dwell in dwells)
        if at_rest and before is not None:
            turns_deg.append(angle_deg(before.T @ difference))
        before = difference if at_rest else None
    # Of each sensor: white, and what a correlated process changes in a period.
    white, slow = np.degrees([AURORA.white.angle_rms_rad, AURORA.slow.angle_rms_rad])
    changed = 1.0 - np.exp(-AURORA.period_s / AURORA.correlation_s)
    of_two = np.sqrt(2.0 * 2.0 * (white**2 + changed * slow**2))
    assert rms(turns_deg) == pytest.approx(of_two, rel=0.1)
    jitter_deg = np.sqrt(2.0 * (white**2 + slow**2))
    errors = typical_errors(18.0)
    joints_deg = np.degrees(len(after[-1].names) * errors.encoder_offset_rad)
    constant_deg = np.degrees(errors.tip_rad + AURORA.distortion.turn_rad) + joints_deg
    assert jitter_deg < rms(off_deg) < np.hypot(jitter_deg, constant_deg)
    assert rms(off_mm) < expected.registration.tolerance_mm


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


def angle_deg(rotation):
    return np.degrees(Rotation.from_matrix(rotation).magnitude())


def test_dropouts_match_the_truth(case, frames):
    start_ns, lost = frames[0].stamp.ns, defaultdict(list)
    names = ("reference", "needle", "cautery")
    for frame in frames:
        valid = {s.source for s in frame.poses if s.status is TrackingStatus.OK}
        for name in set(names) - valid:
            lost[name].append((frame.stamp.ns - start_ns) / NS_PER_S)
    for name, times in lost.items():
        spans = [(d.start_s, d.end_s) for d in case.expected().dropouts if d.frame == name]
        assert all(any(start <= t <= end for start, end in spans) for t in times)
        for start, end in spans:
            assert any(start <= t <= end for t in times)
