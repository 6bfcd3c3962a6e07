"""A session that does not measure far structures decides as one that measures all."""

import json
from dataclasses import replace

import numpy as np
import pytest

from app.case import TrackingFrame
from app.cli.live_lines import as_json_line
from app.fixture import FixtureDecision, MarginObservation, MarginState, Reason
from app.geometry import NS_PER_MS, NS_PER_S, Stamp, TrackedTransform, TrackingStatus, Transform
from app.registration import DriftBound, given_registration, tre_growth
from app.robot import load_robot
from app.session import Session, structure_line
from app.session.far_structures import BEYOND_MM, FarStructures
from app.session.pose_tree import MeasuredPose
from app.session.setup import REFERENCE, RobotSetup, TrackingError
from tests.doubles import near
from tests.oracles.fixture_oracle import random_pose
from tests.session.structure_worlds import FRAMES, TIP, random_bodies, setup_of, tracker_poses
from tests.session_content import one_link_content

pytestmark = pytest.mark.slow


def roaming_frames(rng, count):
    """A tool that passes among structures at up to 0.3 m/s; every thirtieth frame has a fault."""
    phases, turn, now_ns = rng.uniform(0.0, 6.0, size=3), rng.normal(size=3), 10**10
    for at in range(count):
        now_ns += 20 * NS_PER_MS
        tip_mm = 120.0 * np.sin(2.0 * np.pi * np.array([0.23, 0.31, 0.17]) * at / 50.0 + phases)
        turn = turn + 0.02 * rng.normal(size=3)
        samples = {
            name: TrackedTransform(pose, Stamp(now_ns), TrackingStatus.OK)
            for name, pose in tracker_poses(rng, tip_mm, turn).items()
        }
        if at > 2 and rng.random() < 1.0 / 30.0:
            match rng.integers(4):
                case 0:
                    lost = str(rng.choice(list(samples)))
                    samples[lost] = TrackedTransform.lost(
                        "tracker", lost, Stamp(now_ns), TrackingStatus.OUT_OF_VIEW
                    )
                case 1:
                    del samples[str(rng.choice(list(samples)))]
                case 2:
                    now_ns += NS_PER_S  # a gap
                case 3:
                    now_ns -= NS_PER_S  # the clock goes back
        yield TrackingFrame(Stamp(now_ns), tuple(samples.values()), ())


def same_decision(found, expected):
    """The values of a decision that do not depend on planes."""
    for name in ("state", "reasons", "margin", "hold", "stamp", "constraint_is_current"):
        assert getattr(found, name) == getattr(expected, name), name
    assert (found.proximity is None) == (expected.proximity is None)
    if found.proximity is not None:
        # A search that starts elsewhere may end elsewhere within the tolerance of far distances.
        assert found.proximity.lower_bound_mm <= expected.proximity.signed_distance_mm
        assert expected.proximity.lower_bound_mm <= found.proximity.signed_distance_mm
        assert found.proximity.contact == expected.proximity.contact


def clearances_mm(constraint):
    rows = constraint.rows
    return np.einsum("ij,ij->i", rows[:, 1:4], rows[:, 4:7]) - rows[:, 0]


def compare(seed, structures, frames):
    """Returns how many structures were measured, far, and far at a step before they were not."""
    rng = np.random.default_rng(seed)
    bodies = random_bodies(rng, structures, spread_mm=100.0)
    skipping, measuring = (
        Session(setup_of(bodies), free_motion=True, skip_far=skip) for skip in (True, False)
    )
    counts, before = np.zeros(3, int), set()
    for frame in roaming_frames(rng, frames):
        found, expected = skipping.step(frame), measuring.step(frame)
        same_decision(found.decision, expected.decision)
        assert found.hold_causes == expected.hold_causes
        assert (found.between_frames is None) == (expected.between_frames is None)
        far = set()
        for number, (each, exact) in enumerate(
            zip(found.structures, expected.structures, strict=True)
        ):
            if each.at_least_mm is None:
                same_decision(each.decision, exact.decision)
                continue
            far.add(number)
            assert each.at_least_mm <= exact.decision.proximity.signed_distance_mm
            assert exact.decision.state is MarginState.NEGATIVE
            assert exact.decision.reasons == (Reason.CLEAR,) == each.decision.reasons
            assert each.decision.stamp == exact.decision.stamp
            assert number not in found.half_spaces_of
        if far and found.decision.constraint_is_current:
            least_mm = min(
                clearances_mm(expected.structures[number].decision.constraint).min()
                for number in far
            )
            free = found.decision.constraint.free
            assert free.distance_mm <= least_mm and least_mm > BEYOND_MM
            assert free.turn_rad * skipping.setup.proximity.radius_mm <= least_mm
        counts += len(found.structures) - len(far), len(far), len(before - far)
        before = far
        if found.decision.hold and found.decision.state is not MarginState.UNKNOWN:
            skipping.rearm()
            measuring.rearm()
    return counts


def test_far_structure_is_written_with_the_bound_of_its_distance():
    rng = np.random.default_rng(1)
    session = Session(setup_of(random_bodies(rng, 3, spread_mm=100.0)), skip_far=True)
    steps = map(session.step, roaming_frames(rng, 300))
    is_far = [False, True, False]
    step = next(s for s in steps if [bool(e.at_least_mm) for e in s.structures] == is_far)
    _, far, near = step.structures
    assert far.at_least_mm > BEYOND_MM
    assert structure_line(far).endswith(f": CLEAR, at least {int(far.at_least_mm)} mm")
    _, far_values, near_values = json.loads(as_json_line(step, "", one_link_content()))[
        "structures"
    ]
    assert (far_values["signed_distance_mm"], far_values["at_least_mm"]) == (None, far.at_least_mm)
    assert near_values["signed_distance_mm"] == near.decision.proximity.signed_distance_mm
    assert "at_least_mm" not in near_values


def poses_at(setup, now, tip):
    """The tip in all frames of the structures, at ``tip`` in each."""
    names = {REFERENCE, *(each.frame_from_structure.target for each in setup.guarded)}
    return {
        name: MeasuredPose(
            Transform(name, tip.source, tip.rotation, tip.translation_mm), now, 0, frozenset()
        )
        for name in names
    }


def observed(now, *problems, sigma_mm=0.0):
    return MarginObservation(now, now, None, frozenset(problems), sigma_mm, 0)


def measured(now, distance_mm):
    return FixtureDecision(
        MarginState.NEGATIVE,
        (Reason.CLEAR,),
        near(distance_mm, slack_mm=0.0, stamp=now),
        *(None, None),
        hold=False,
        stamp=now,
        seq=1,
        constraint_is_current=True,
    )


def test_pose_of_a_failed_step_is_not_that_of_a_later_distance():
    setup = setup_of(random_bodies(np.random.default_rng(1), 2))
    far = FarStructures(setup)

    def found(ms, x_mm, *problems):
        now = Stamp(NS_PER_S + ms * NS_PER_MS)
        tip = Transform("tracker", "cautery_tip", np.eye(3), [x_mm, 0.0, 0.0])
        return now, far.found(poses_at(setup, now, tip), observed(now, *problems))

    def end(now):
        far.end(now, {}, {1: measured(now, 200.0)})

    end(found(0, 300.0)[0])
    assert found(20, 200.0)[1][1].at_least_mm == pytest.approx(100.0, abs=0.01)
    # That step fails: it has no end.
    end(found(40, 300.0, Reason.MISSING)[0])
    assert found(60, 200.0)[1] == {}


def test_bound_of_a_far_structure_falls_by_the_motion_in_its_own_frame():
    bodies = [
        replace(body, frame_from_body=body.frame_from_body.renamed(target=frame))
        for body, frame in zip(random_bodies(np.random.default_rng(1), 3), FRAMES, strict=True)
    ]
    far = FarStructures(setup_of(bodies))
    for ms, at_mm in ((0, (300.0, 300.0, 300.0)), (20, (300.0, 290.0, 280.0))):
        now, poses = Stamp(NS_PER_S + ms * NS_PER_MS), {}
        for frame, x_mm in zip(FRAMES, at_mm, strict=True):
            tip = Transform(frame, "cautery_tip", np.eye(3), [x_mm, 0.0, 0.0])
            poses[frame] = MeasuredPose(tip, now, 0, frozenset())
        found = far.found(poses, observed(now))
        far.end(now, found, {number: measured(now, 200.0) for number in (1, 2)})
    assert found[1].at_least_mm == pytest.approx(190.0, abs=0.01)
    assert found[2].at_least_mm == pytest.approx(180.0, abs=0.01)


def test_gap_is_that_of_the_margins_in_use():
    """After a gap nothing is far: the margin is UNKNOWN."""
    setup = setup_of(random_bodies(np.random.default_rng(1), 2))
    far, gap_ns = FarStructures(setup), 3 * setup.margins.stale_after_ns // 4
    tip = Transform("tracker", "cautery_tip", np.eye(3), [300.0, 0.0, 0.0])
    for divisor, is_far in ((1, True), (2, False)):
        stale_after_ns = setup.margins.stale_after_ns // divisor
        far.use(replace(setup, margins=setup.margins.replaced(stale_after_ns=stale_after_ns)))
        for now in (Stamp(NS_PER_S), Stamp(NS_PER_S + gap_ns)):
            found = far.found(poses_at(setup, now, tip), observed(now))
            far.end(now, found, {1: measured(now, 200.0)})
        assert (1 in found) is is_far


def test_clearance_of_a_far_structure_is_that_of_the_largest_margin(project_root):
    """Its distance and its margin, wherever the witnesses are, by NumPy."""
    rng = np.random.default_rng(6)
    arm = load_robot(project_root / "data" / "robots" / "touch" / "touch.urdf")
    bodies = setup_of(random_bodies(rng, 3))
    counts = np.zeros(2, dtype=int)
    for _ in range(300):
        factor = rng.normal(size=(6, 6)) * np.repeat([0.004, 0.3], 3)[:, None]
        registration = given_registration(
            random_pose(rng, 50.0, REFERENCE, "robot_base"), factor @ factor.T
        )
        setup = replace(
            bodies,
            tracking=TrackingError(sigma_mm=rng.uniform(0.0, 1.0), sigma_rad=rng.uniform(0, 0.02)),
            tip_sigma_mm=0.3,
            robot=RobotSetup(arm, "robot_base", "stylus", registration, DriftBound(5.0, 0.1)),
        )
        far, now = FarStructures(setup), Stamp(NS_PER_S)
        before, after = (random_pose(rng, 60.0, "tracker", "cautery_tip") for _ in range(2))
        distances_mm = rng.uniform(60.0, 500.0, 3)
        far.found(poses_at(setup, now, before), observed(now))
        far.end(now, {}, {k: measured(now, distances_mm[k]) for k in (1, 2)})
        sigma_mm, now = rng.uniform(0.0, 2.0), Stamp(NS_PER_S + 20 * NS_PER_MS)
        found = far.found(poses_at(setup, now, after), observed(now, sigma_mm=sigma_mm))
        turn_rad = np.linalg.norm((before.inverse() @ after).rotation_vector)
        way_mm = np.linalg.norm(after.translation_mm - before.translation_mm)
        lever_mm = np.linalg.norm(after.translation_mm)
        for k in (1, 2):
            each = setup.guarded[k]
            radius_mm, margins = each.proximity.radius_mm, setup.margins
            at_least_mm = distances_mm[k] - way_mm - radius_mm * turn_rad
            lever = np.hypot(np.linalg.norm(TIP.translation_mm) + radius_mm, lever_mm + radius_mm)
            tracking = setup.tracking
            tracked_mm = np.hypot(np.sqrt(2.0) * tracking.sigma_mm, tracking.sigma_rad * lever)
            registered_mm = sigma_mm + tre_growth(registration) * radius_mm
            squares = registered_mm**2 + tracked_mm**2 + each.sigma_mm**2 + setup.tip_sigma_mm**2
            age_mm = margins.v_max_mm_s * margins.stale_after_ns / NS_PER_S
            margin_mm = each.stop_mm + margins.k_tre * np.sqrt(squares) + age_mm
            clearance_mm = at_least_mm - margin_mm
            needed_mm = each.warn_mm - each.stop_mm + margins.release_band_mm + BEYOND_MM
            assert (k in found) == (clearance_mm >= needed_mm)
            counts[int(k in found)] += 1
            if k in found:
                assert found[k] == pytest.approx((at_least_mm, clearance_mm), abs=1e-3)
    assert counts.min() > 100


@pytest.mark.parametrize(("seed", "structures"), [(1, 3), (3, 2)])
def test_far_structures_change_no_decision(seed, structures):
    measured, far, woken = compare(seed, structures, frames=300)
    assert far > 20 and measured > 300 and woken > 5
