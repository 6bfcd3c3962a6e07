"""The committed case that the demo replays: recording, robot and truth are consistent."""

import hashlib
from collections import defaultdict

import numpy as np
import pytest

from app.case import open_case
from app.geometry import NS_PER_S, TrackingStatus
from app.robot import load_robot


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


def test_the_joints_of_our_robot_follow_the_tracked_tool(case, frames):
    """Checks kinematics, clock offset, calibration and true registration together."""
    manifest, expected = case.manifest, case.expected()
    robot = load_robot(case.robot_urdf())
    held_until_s = max(dwell.end_s for dwell in manifest.registration.dwells)
    off_mm, off_deg = [], []
    for frame in frames:
        if frame.stamp.ns > frames[0].stamp.ns + held_until_s * NS_PER_S:
            break
        after = [s for s in frame.joints if frame.stamp.ns - s.stamp.ns < 5_000_000]
        poses = {s.source: s.transform for s in frame.poses if s.status is TrackingStatus.OK}
        links = robot.forward_kinematics(after[-1].as_mapping())
        base_from_tip = links[manifest.robot.tool_link].renamed(
            target=manifest.robot.base_frame, source=manifest.tool.tip_frame
        )
        by_arm = expected.registration.reference_from_base @ base_from_tip
        by_tracker = poses["reference"].inverse() @ poses["cautery"] @ manifest.tool.tool_from_tip
        off_mm.append(by_arm.distance_mm_to(by_tracker))
        off_deg.append(np.degrees(by_arm.angle_to(by_tracker)))
    # Two sensors of 0.3 degrees; at the tip, some 150 mm from the reference, about 1 mm.
    assert np.sqrt(np.mean(np.square(off_deg))) == pytest.approx(0.3 * np.sqrt(2.0), rel=0.1)
    assert 0.4 < np.sqrt(np.mean(np.square(off_mm))) < 1.5


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
