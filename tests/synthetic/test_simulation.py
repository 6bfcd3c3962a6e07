"""The simulated scenario: true poses, and the noisy recording of them."""

import numpy as np
import pytest

from app.geometry import NS_PER_S, TrackingStatus
from app.synthetic import Recording, SimulatedTracker, find_breaches, tool_mesh
from app.synthetic.simulation import HANDLE_END_MM, TOOL_FROM_TIP, TRACKED_FRAMES
from app.synthetic.tracker_model import WHITE
from app.synthetic.truth import dense_surface
from tests.oracles.winding_number import any_point_inside
from tests.synthetic.test_motion import assert_same

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def breaches(simulation):
    return find_breaches(simulation.clearance, simulation.tumor_from_tip, simulation.duration_s)


@pytest.fixture(scope="module")
def frames(simulation):
    return list(Recording(simulation, SimulatedTracker(WHITE, [2])).frames())


@pytest.fixture(scope="module")
def inside(simulation):
    """Function of time: whether the tool is in the tumour, by an independent method."""
    mesh, tool = simulation.tumour.mesh(), tool_mesh()
    near = (tool.triangles_mm[:, :, 2] > -66.1).all(axis=1)
    points = dense_surface(tool.triangles_mm[near], 0.4)

    def at(time_s):
        return any_point_inside(simulation.tumor_from_tip(time_s).apply(points), mesh)

    return at


def test_simulation_has_three_breaches_of_their_kinds(breaches):
    deep, brief, shaft = breaches
    assert deep.min_signed_distance_mm == pytest.approx(-5.0, abs=0.1) and not deep.shaft_only
    assert brief.min_signed_distance_mm == pytest.approx(-1.8, abs=0.1) and not brief.shaft_only
    assert 0.25 <= brief.end_s - brief.start_s <= 0.4
    assert shaft.min_signed_distance_mm == pytest.approx(-2.8, abs=0.1) and shaft.shaft_only
    assert shaft.tip_clearance_mm > 5.0


def test_breach_times_agree_with_libigl(breaches, inside):
    # 4 ms at 45 mm/s are 0.18 mm, more than the error of facets and samples.
    for breach in breaches:
        assert [inside(breach.start_s - 0.004), inside(breach.start_s + 0.004)] == [False, True]
        assert [inside(breach.end_s - 0.004), inside(breach.end_s + 0.004)] == [True, False]
        assert inside((breach.start_s + breach.end_s) / 2.0)


def test_surfaces_are_crossed_fast_enough_to_be_timed(simulation, breaches):
    for breach in breaches:
        for time_s in (breach.start_s, breach.end_s):
            before, after = (
                simulation.clearance.distance_mm(simulation.tumor_from_tip(time_s + step))
                for step in (-0.004, 0.004)
            )
            assert abs(after - before) / 0.008 >= 30.0


def test_tool_stays_outside_between_breaches(simulation, breaches):
    # The tool approaches during the last quarter of a second before a crossing.
    times = [
        time_s
        for time_s in np.arange(0.0, simulation.duration_s, 0.1)
        if not any(b.start_s - 0.25 < time_s < b.end_s + 0.25 for b in breaches)
    ]
    clearance = simulation.clearance
    poses = [simulation.tumor_from_tip(time_s) for time_s in times]
    near = [pose for pose in poses if clearance.distance_per_height * clearance.height_mm(pose) < 3]
    assert 2.5 < min(clearance.distance_mm(pose) for pose in near) < 4.0


def test_arm_is_at_rest_on_landmarks_during_the_breath_hold(simulation):
    points = []
    for start_s, end_s in simulation.scenario.dwells_s:
        assert end_s - start_s == pytest.approx(1.2)
        assert end_s < simulation.scenario.breath_held_until_s
        poses = [simulation.base_from_tip(t) for t in np.linspace(start_s, end_s, 25)]
        assert all((pose.matrix == poses[0].matrix).all() for pose in poses)
        references = [simulation.tracker_from("reference", t) for t in (start_s, end_s)]
        assert references[0].distance_mm_to(references[1]) == 0.0
        points.append(poses[0].translation_mm)
    spread = np.linalg.svd(np.array(points) - np.mean(points, axis=0), compute_uv=False)
    assert len(points) == 8
    assert spread.min() > 40.0  # far from coplanar
    assert np.ptp(points, axis=0).min() > 50.0


def test_registration_is_exact_at_end_expiration_only(simulation):
    def off_mm(time_s):
        reference_from_tip = (
            simulation.tracker_from("reference", time_s).inverse()
            @ simulation.tracker_from("cautery", time_s)
            @ TOOL_FROM_TIP
        )
        by_arm = simulation.reference_from_base @ simulation.base_from_tip(time_s)
        return reference_from_tip.distance_mm_to(by_arm)

    held_until_s = simulation.scenario.breath_held_until_s
    assert off_mm(1.0) < 1e-9
    assert 0.3 < off_mm(held_until_s + 2.0) < 2.0
    assert off_mm(held_until_s + 4.0) < 1e-6


def test_tissue_moves_four_to_five_millimetres_and_the_chest_a_little(simulation):
    held_until_s = simulation.scenario.breath_held_until_s
    for frame, low, high in (("needle", 4.0, 5.0), ("reference", 1.0, 1.4)):
        rest, full = (simulation.tracker_from(frame, held_until_s + t) for t in (0.0, 2.0))
        assert low < rest.distance_mm_to(full) < high


def test_frames_come_at_50_hz_but_for_one_silence(frames, simulation):
    stamps = np.array([frame.stamp.ns for frame in frames])
    gaps = np.diff(stamps) / NS_PER_S
    assert (gaps > 0.021).sum() == 1 and gaps.max() == pytest.approx(0.62, abs=0.021)
    assert np.delete(gaps, gaps.argmax()).max() == pytest.approx(0.02)
    assert (stamps[-1] - stamps[0]) / NS_PER_S == pytest.approx(simulation.duration_s)


def test_joints_come_at_200_hz_on_the_robots_clock_through_every_dropout(frames):
    joints = [sample for frame in frames for sample in frame.joints]
    stamps = np.array([sample.stamp.ns for sample in joints])
    assert {sample.stamp.clock for sample in joints} == {"robot"}
    assert (np.diff(stamps) == 5_000_000).all() and (stamps % 5_000_000 == 0).all()


def test_forward_kinematics_of_joints_gives_the_true_tool_pose(frames, simulation, gantry):
    joints = [sample for frame in frames[::40] for sample in frame.joints]
    for sample in joints:
        time_s = (sample.stamp.ns + 37_400_000 - frames[0].stamp.ns) / NS_PER_S
        by_joints = gantry.base_from_tool(sample.as_mapping())
        truth = simulation.tracker_from_base.inverse() @ simulation.tracker_from("cautery", time_s)
        assert (truth @ TOOL_FROM_TIP).distance_mm_to(by_joints) < 1e-9


def test_recorded_poses_are_the_truth_with_jitter(frames, simulation):
    for name in TRACKED_FRAMES:
        shifts, turns = [], []
        for frame in frames[::3]:
            for sample in frame.poses:
                if sample.source == name and sample.transform is not None:
                    time_s = (frame.stamp.ns - frames[0].stamp.ns) / NS_PER_S
                    truth = simulation.tracker_from(name, time_s)
                    shifts.append(sample.transform.distance_mm_to(truth))
                    turns.append(np.degrees(sample.transform.angle_to(truth)))
        # The RMS of 1200 errors has a standard error of 1.2 %.
        assert np.sqrt(np.mean(np.square(shifts))) == pytest.approx(0.3, rel=0.06)
        assert np.sqrt(np.mean(np.square(turns))) == pytest.approx(0.3, rel=0.06)


def test_dropouts_of_every_kind_happen_near_the_tumour_but_not_in_a_breach(
    frames, simulation, breaches
):
    dropouts = simulation.scenario.dropouts
    assert {(len(d.frames), d.kind) for d in dropouts} == {
        (1, "invalid"),
        (1, "missing"),
        (3, "missing"),
    }
    for dropout in dropouts:
        for breach in breaches:
            assert dropout.end_s < breach.start_s - 1.0 or breach.end_s + 1.0 < dropout.start_s
    distances = [
        simulation.clearance.distance_mm(simulation.tumor_from_tip(d.start_s)) for d in dropouts
    ]
    assert min(distances) < 4.0 and max(distances) > 7.0


def test_dropouts_lose_exactly_their_samples(frames, simulation):
    for frame in frames:
        time_s = (frame.stamp.ns - frames[0].stamp.ns) / NS_PER_S
        active = [d for d in simulation.scenario.dropouts if d.covers(time_s)]
        missing = {name for d in active if d.kind == "missing" for name in d.frames}
        invalid = {name for d in active if d.kind == "invalid" for name in d.frames}
        assert {sample.source for sample in frame.poses} == set(TRACKED_FRAMES) - missing
        not_ok = {s.source for s in frame.poses if s.status is TrackingStatus.INVALID}
        assert not_ok == invalid
        assert all(s.stamp == frame.stamp for s in frame.poses)


def test_poses_of_a_simulation_at_many_times_are_those_at_each(simulation):
    times_s = np.concatenate([[-1.0, 0.0], np.linspace(0.3, simulation.duration_s + 1.0, 60)])
    single = times_s.tolist()
    tips = [simulation.tumor_from_tip(time_s) for time_s in single]
    assert_same(simulation.tumor_from_tips(times_s), tips)
    poses, metal_mm = simulation.tracked(times_s)
    for name, tracked in zip(TRACKED_FRAMES, poses, strict=True):
        assert_same(tracked, [simulation.tracker_from(name, time_s) for time_s in single])
    ends = np.array([[0.0, 0.0, -HANDLE_END_MM]])
    for (start_mm, end_mm), time_s in zip(metal_mm, single, strict=True):
        base = simulation.tracker_from_base
        np.testing.assert_allclose(start_mm, base.translation_mm)
        tracker_from_tip = base @ simulation.base_from_tip(time_s)
        np.testing.assert_allclose(end_mm, tracker_from_tip.apply(ends)[0])
