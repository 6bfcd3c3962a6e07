"""Tissue, tracker and hand: what moves and measures a world from outside."""

import numpy as np
import pytest

from app.geometry import TrackingStatus, Transform
from app.simulation import (
    BreathingEntry,
    HandEntry,
    Push,
    ScriptedHand,
    TissueEntry,
    TissueShift,
    TrackerEntry,
    WorldState,
    WorldTracker,
)
from app.simulation.body_model import TissueMotion
from app.synthetic.motion import Breathing, BreathingBody
from app.synthetic.tracker_model import AURORA, Jitter, TrackerModel
from tests.simulation.conftest import box, placed


def state(time_ms: int, **bodies: Transform) -> WorldState:
    return WorldState(time_ms * 1_000_000, {}, bodies)


def test_tissue_breathes_after_the_hold_and_shifts_stay():
    entry = TissueEntry(
        "tumor",
        box("tumor", 10, 10, 10),
        placed("tumor", 1, 2, 3),
        np.array([0.0, 0.0, 4.0]),
        np.array([0.1, 0.0, 0.0]),
        (TissueShift(10.0, 12.0, np.array([2.0, 0.0, 0.0])),),
    )
    motion = TissueMotion(entry, BreathingEntry(0.25, held_until_s=1.0))
    assert motion.at(0.9)[0].tolist() == [1, 2, 3]
    position, quaternion = motion.at(3.0)
    assert position == pytest.approx([1, 2, 7])
    assert quaternion == pytest.approx([np.cos(0.05), np.sin(0.05), 0, 0])
    assert motion.at(5.0)[0] == pytest.approx([1, 2, 3])
    assert motion.at(11.0)[0][0] == pytest.approx(2.0)
    assert motion.at(101.0)[0] == pytest.approx([3, 2, 3])


def test_tissue_breathes_as_the_bodies_of_simulated_cases():
    turned = Transform.from_rotation_vector((0.3, -1.0, 0.2), (4, 5, 6), target="world", source="t")
    shift, turn = np.array([1.0, 2.0, 3.0]), np.array([0.02, -0.05, 0.01])
    entry = TissueEntry("t", box("t", 1, 1, 1), turned, shift, turn)
    motion, breathing = TissueMotion(entry, BreathingEntry()), Breathing(0.0)
    for time_s in (0.5, 1.1, 2.0, 3.7):
        expected = BreathingBody(turned, shift, turn).at(breathing.depth(time_s))
        position, (w, x, y, z) = motion.at(time_s)
        assert position == pytest.approx(expected.translation_mm, abs=1e-12)
        found = Transform.from_quaternion((x, y, z, w), position, target="world", source="t")
        assert found.rotation == pytest.approx(expected.rotation, abs=1e-12)


def samples(model: TrackerModel, seed: int, seconds: int) -> list[tuple[int, np.ndarray]]:
    tracker, found = WorldTracker(TrackerEntry(("tumor",), model), seed), []
    for time_ms in range(1000 * seconds):
        tracker.observe(state(time_ms, tumor=placed("tumor", 0.001 * time_ms, 0, 0)))
        for (sample,) in tracker.arrived(time_ms * 1_000_000):
            assert sample.target == "tracker"
            if sample.status is TrackingStatus.OK:
                found.append((sample.stamp.ns, sample.transform.translation_mm))
    return found


def test_samples_are_late_by_the_latency_and_as_noisy_as_the_model():
    model = TrackerModel("test", 50.0, Jitter(0.3, 0.0), latency_s=0.02)
    found = samples(model, 3, 20)
    assert [stamp for stamp, _ in found[:3]] == [20_000_000, 40_000_000, 60_000_000]
    truth = np.array([[1e-9 * (stamp - 20_000_000), 0, 0] for stamp, _ in found])
    errors = np.array([position for _, position in found]) - truth
    assert np.sqrt((errors**2).sum(axis=1).mean()) == pytest.approx(0.3, rel=0.1)


def test_same_seed_gives_the_same_samples():
    first, second, other = (samples(AURORA, seed, 3) for seed in (1, 1, 2))
    assert [each[0] for each in first] == [each[0] for each in second]
    assert np.array_equal([each[1] for each in first], [each[1] for each in second])
    assert not np.array_equal(first[0][1], other[0][1])


def test_hand_pushes_at_its_target_and_away_from_it():
    entry = HandEntry(
        "arm", 10.0, 100.0, pushes=(Push(1, 2, "tumor"), Push(3, 4, "tumor", retreat=True))
    )
    hand = ScriptedHand(entry, "cautery")
    assert hand.admittance_mm_s_n == 10.0
    bodies = {"tumor": placed("tumor", 0, 0, 0), "cautery": placed("cautery", 0, 0, 50)}

    def force(time_ms: int, **changed: Transform) -> list[float]:
        return hand.wrench(state(time_ms, **{**bodies, **changed})).force_n.tolist()

    assert force(500) == [0, 0, 0]
    assert force(1500) == [0, 0, -10]
    assert force(2500) == [0, 0, 0]
    assert force(3500) == [0, 0, 10]
    assert force(1500, cautery=placed("cautery", 0, 0, 1)) == pytest.approx([0, 0, -2])
    assert force(3500, cautery=placed("cautery", 1, 0, 0)) == pytest.approx([10, 0, 0])
    assert force(3500, cautery=placed("cautery", 0.1, 0, 0)) == pytest.approx([0, 0, 10])
