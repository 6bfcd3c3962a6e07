"""Sessions for the recorded case with every registration method and clock setting."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
import yaml

from app.case import Dwell, open_case
from app.fixture import MarginState, Reason
from app.geometry import NS_PER_MS, NS_PER_S, InputError, Stamp, Transform
from app.registration import TooFewError
from app.session import (
    PoseRules,
    PoseTree,
    Session,
    setup_from_case,
    tip_signals,
    with_estimated_clock,
)
from app.session.case_preparation import dwell_poses
from app.synthetic.simulation import ROBOT_TO_TRACKER_OFFSET_NS
from app.synthetic.tracker_model import AURORA
from tests.doubles import frame, sample
from tests.shipped_case import CLOCK_OFFSET_MS

pytestmark = pytest.mark.slow


@pytest.fixture
def recorded(case, tmp_path):
    """The recorded case, or a copy with other blocks."""

    def with_blocks(**blocks):
        if not blocks:
            return case
        folder = tmp_path / "case"
        shutil.copytree(case.folder, folder)
        manifest = yaml.safe_load((folder / "case.yaml").read_text())
        (folder / "case.yaml").write_text(yaml.safe_dump({**manifest, **blocks}))
        return open_case(folder)

    return with_blocks


def at_dwells(*spans):
    dwells = [{"start_s": start_s, "end_s": end_s} for start_s, end_s in spans]
    return {"method": "paired_points", "dwells": dwells}


def error_of(case, setup):
    """Distance in mm and angle in degrees of the registration from the truth."""
    truth = case.expected().registration.reference_from_base
    found = setup.robot.registration.transform
    return found.distance_mm_to(truth), np.degrees(found.angle_to(truth))


@pytest.mark.parametrize("method", ["paired_points", "robot_world"])
def test_base_is_registered_from_dwells(recorded, method):
    manifest = yaml.safe_load((recorded().folder / "case.yaml").read_text())
    dwells = manifest["registration"]["dwells"][:7]
    case = recorded(registration={"method": method, "dwells": dwells})
    setup = setup_from_case(case, tip_only=True)
    distance_mm, angle_deg = error_of(case, setup)
    assert setup.robot.registration.accepted
    assert setup.robot.registration.method == method
    # Accuracy matters at the corners of the box around the tumour.
    assert len(dwells) == 7
    assert "at the worst of 8 targets" in setup.robot.registration.reason
    assert distance_mm < 1.0
    assert angle_deg < 0.5
    # The simulation mounts the tool along the link, so that its pose in the link is the identity.
    assert np.degrees(np.arccos((np.trace(setup.robot.link_from_tip.rotation) - 1) / 2)) < 1.0


@pytest.mark.parametrize(
    ("spans", "error", "message"),
    [
        ([(0.05, 2.0)], InputError, r"moved by .* in dwell 1"),
        ([(0.05, 1.25), (2.35, 3.55)], TooFewError, "at least 3"),
    ],
    ids=["moving robot", "too few"],
)
def test_unusable_dwells_are_rejected(recorded, spans, error, message):
    case = recorded(registration=at_dwells(*spans))
    with pytest.raises(error, match=message):
        setup_from_case(case, tip_only=True)


def test_repeated_pose_counts_once_in_a_dwell(case, case_setup, case_frames):
    """The tool every 150 ms, within its stale limit, and the reference at 50 Hz."""
    held = case_frames[0].joints[0]
    frames = [
        frame(
            at_ms,
            sample("tracker", "reference", (0.0, 0.0, 0.001 * at_ms), at_ms),
            *([sample("tracker", "cautery", (5.0, 0.0, 0.0), 0)] if at_ms == 0 else []),
            joints=(replace(held, stamp=Stamp(at_ms * NS_PER_MS)),),
        )
        for at_ms in range(0, 160, 20)
    ]
    poses = PoseTree(PoseRules(case_setup.margins.freshness_limits, ("cautery",)))
    with pytest.raises(InputError, match="dwell 1 has 1 good samples of 'cautery' in 'reference'"):
        dwell_poses(
            frames,
            [Dwell(0.0, 0.15)],
            poses,
            tool_from_tip=case.manifest.tool.tool_from_tip,
            robot=case_setup.robot,
        )


def test_dwell_with_a_moving_reference_is_rejected(case, case_setup, case_frames):
    """The robot stands still while the chest with the reference moves."""
    tool_from_tip = case.manifest.tool.tool_from_tip

    def poses_of(rise_mm_a_frame):
        frames = [
            replace(each, poses=tuple(risen(p, rise_mm_a_frame * n) for p in each.poses))
            for n, each in enumerate(case_frames[:75])
        ]
        tree = PoseTree(PoseRules(case_setup.margins.freshness_limits, ("cautery",)))
        return dwell_poses(
            frames, [Dwell(0.05, 1.25)], tree, tool_from_tip=tool_from_tip, robot=case_setup.robot
        )

    assert len(poses_of(0.0)) == 1
    with pytest.raises(InputError, match=r"tip of 'cautery' in 'reference' moved by .* in dwell 1"):
        poses_of(0.2)


def risen(pose, shift_mm):
    if pose.source != "reference" or pose.transform is None:
        return pose
    here = pose.transform
    shift = Transform("tracker", "tracker", np.eye(3), np.array([0.0, 0.0, shift_mm]))
    return replace(pose, transform=shift @ here)


def test_repeated_pose_counts_once_in_the_motion_for_the_clock(case, case_setup, case_frames):
    frames = case_frames
    sparse = [
        replace(each, poses=tuple(p for p in each.poses if p.source != "cautery" or k % 4 == 0))
        for k, each in enumerate(frames)
    ]
    (_, all_of_it), (_, seen) = tip_signals(case, frames), tip_signals(case, sparse)
    assert len(seen.times_ns) == pytest.approx(len(all_of_it.times_ns) / 4, abs=1)


def test_given_clock_offset_is_not_estimated(recorded):
    case, offset = with_estimated_clock(recorded())
    assert offset is None
    given_ns = round(CLOCK_OFFSET_MS * NS_PER_MS)
    assert case.manifest.clock.offset_robot_to_tracker_ns == given_ns


def test_clock_offset_of_the_joints_is_estimated_from_motion(recorded):
    found, offset = with_estimated_clock(recorded(clock={"estimate": True}))
    true_ns = ROBOT_TO_TRACKER_OFFSET_NS + round(AURORA.latency_s * NS_PER_S)
    assert offset.offset_ns == pytest.approx(true_ns, abs=1_000_000)
    assert found.manifest.clock.offset_robot_to_tracker_ns == offset.offset_ns
    low, high = offset.interval_ns
    assert low <= true_ns <= high


def test_wrong_registration_is_reported_as_drift(recorded):
    matrix = recorded().expected().registration.reference_from_base.matrix
    matrix[0, 3] += 8.0
    case = recorded(registration={"method": "given", "matrix": matrix.ravel().tolist()})
    session = Session(setup_from_case(case, tip_only=True))
    frames = case.frames()
    steps = [session.step(next(frames)) for _ in range(200)]
    for step in steps[5:]:
        assert step.decision.state is MarginState.UNKNOWN
        assert Reason.REGISTRATION_DRIFT in step.decision.reasons
