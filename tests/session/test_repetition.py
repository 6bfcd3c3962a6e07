"""Repetitions of sensors that rest, move, quantise or are stuck."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.fixture import Reason
from app.geometry import NS_PER_MS, FreshnessLimits
from app.session.pose_tree import PoseRules, PoseTree
from app.session.repetition import (
    REST_LIMIT,
    SENSOR_REPETITION,
    change,
    keep_change,
    probability,
)
from tests.doubles import frame, sample
from tests.session.frozen_sensors import clean_run, inject, moments, quantised, recorded

pytestmark = pytest.mark.slow

LIMITS = FreshnessLimits(200 * NS_PER_MS, frozen_after_ns=1000 * NS_PER_MS)
PERIOD_MS = 20
EDGE = ("tracker", "cautery")
OTHER = ("tracker", "needle")


class Tracker:
    """Feeds a `PoseTree` with positions in quantisation steps of 0.1 mm, every 20 ms."""

    def __init__(self, *edges: tuple[str, str]) -> None:
        self.tree = PoseTree(PoseRules(LIMITS, ("cautery", "needle")))
        self.edges = edges or (EDGE,)
        self.at_ms = 0
        self.last = dict.fromkeys(self.edges, 0)

    def send(self, *steps: int) -> "Tracker":
        """One frame with each sensor's position in steps along z."""
        self.at_ms += PERIOD_MS
        self.last = dict(zip(self.edges, steps, strict=True))
        poses = [
            sample(*edge, (0.0, 0.0, step / 10.0), self.at_ms) for edge, step in self.last.items()
        ]
        self.tree.insert(frame(self.at_ms, *poses))
        return self

    def repeat(self, duration_ms: int) -> "Tracker":
        """Repeat the last frame for ``duration_ms``."""
        for _ in range(duration_ms // PERIOD_MS):
            self.send(*self.last.values())
        return self

    def shake(self, changes: int, *, repeats: int = 0) -> "Tracker":
        """Noise around a place, every value repeated by ``repeats`` further samples."""
        for index in range(changes):
            self.send(*[(index + which) % 2 for which, _ in enumerate(self.edges)])
            self.repeat(repeats * PERIOD_MS)
        return self

    def move(self, samples: int) -> "Tracker":
        """Motion by ten steps per sample, which is 50 mm/s, of all sensors."""
        for _ in range(samples):
            self.send(*[step + 10 for step in self.last.values()])
        return self

    def unchanged_ms(self, edge: tuple[str, str] = EDGE) -> float:
        return self.tree.pose(*edge).unchanged_ns / NS_PER_MS

    def is_frozen(self, edge: tuple[str, str] = EDGE) -> bool:
        return Reason.FROZEN in self.tree.pose(*edge).problems


def test_first_repetition_of_a_sensor_with_noise_is_old_data():
    tracker = Tracker().shake(200)
    assert tracker.unchanged_ms() == 0
    assert tracker.repeat(PERIOD_MS).unchanged_ms() == PERIOD_MS
    assert tracker.repeat(100).unchanged_ms() == 100 + PERIOD_MS
    assert not tracker.repeat(1000 - 100 - PERIOD_MS).is_frozen()
    assert tracker.repeat(PERIOD_MS).is_frozen()


def test_resting_sensor_that_repeats_in_its_history_is_not_punished():
    tracker = Tracker().shake(60, repeats=9)
    for _ in range(9):
        assert tracker.repeat(PERIOD_MS).unchanged_ms() == 0
    assert tracker.shake(1).unchanged_ms() == 0


def test_resting_sensor_that_repeats_longer_than_known_is_old_data_and_frozen_at_last():
    tracker = Tracker().shake(60, repeats=9)
    assert tracker.repeat(2000).unchanged_ms() == 1000  # as far as it is not frozen
    assert not tracker.is_frozen()
    tracker.repeat(REST_LIMIT * 1000 - 2000)
    assert tracker.is_frozen()
    assert tracker.unchanged_ms() > REST_LIMIT * 1000


def test_moving_sensor_cannot_repeat_although_it_does_at_rest():
    tracker = Tracker().shake(60, repeats=9).move(60)
    assert tracker.unchanged_ms() == 0
    tracker.repeat(3 * PERIOD_MS)
    assert tracker.unchanged_ms() == 3 * PERIOD_MS
    assert tracker.repeat(1000).is_frozen()


def test_turning_sensor_cannot_repeat_although_its_position_rests():
    tracker = Tracker().shake(60, repeats=9)
    for index in range(40):
        tracker.at_ms += PERIOD_MS
        turned = sample(*EDGE, (0.0, 0.0, index % 2 / 10.0), tracker.at_ms)
        turn = type(turned.transform).from_rotation_vector(
            (0.0, 0.04 * index, 0.0),
            turned.transform.translation_mm,
            target=EDGE[0],
            source=EDGE[1],
        )
        turned = type(turned).valid(turn, turned.stamp)
        tracker.tree.insert(frame(tracker.at_ms, turned))
    for _ in range(4):
        tracker.at_ms += PERIOD_MS
        again = type(turned).valid(turn, sample(*EDGE, (0, 0, 0), tracker.at_ms).stamp)
        tracker.tree.insert(frame(tracker.at_ms, again))
    assert tracker.unchanged_ms() == 4 * PERIOD_MS


def test_motion_below_a_quantisation_step_per_sample_may_repeat():
    """5 mm/s with 0.1 mm steps: each value comes three times and differs from the last by one."""
    tracker = Tracker().shake(40, repeats=2)
    for step in range(60):
        tracker.send(step).repeat(2 * PERIOD_MS)
    assert tracker.unchanged_ms() == 0


def test_source_whose_sensors_all_repeat_at_once_is_frozen_when_it_would_be_stale():
    tracker = Tracker(EDGE, OTHER).shake(100)
    tracker.repeat(200)
    assert not tracker.is_frozen()
    tracker.repeat(PERIOD_MS)
    assert tracker.is_frozen()
    assert tracker.is_frozen(OTHER)
    assert not tracker.shake(2).is_frozen()


def test_one_sensor_that_repeats_beside_a_live_one_is_frozen_after_its_limit():
    tracker = Tracker(EDGE, OTHER).shake(100)
    for _ in range(1000 // PERIOD_MS):
        tracker.send(tracker.last[EDGE], 1 - tracker.last[OTHER])
    assert not tracker.is_frozen()
    tracker.send(tracker.last[EDGE], 1 - tracker.last[OTHER])
    assert tracker.is_frozen()
    assert not tracker.is_frozen(OTHER)


def test_quantised_sensors_that_rest_together_are_not_stuck():
    """The tool is laid down beside a reference that has repeated while the tool moved."""
    tracker = Tracker(EDGE, OTHER)
    for index in range(200):
        tracker.send(10 * index, index // 3 % 2)
    tool = tracker.last[EDGE] + 1
    tracker.send(tool, 0).send(tool + 1, 1).send(tool, 1).send(tool, 1)
    tracker.repeat(400)
    assert not tracker.is_frozen()


def test_source_that_sends_each_pose_twice_is_current_while_it_moves():
    tracker = Tracker()
    for _ in range(100):
        tracker.move(1).repeat(PERIOD_MS)
    assert tracker.unchanged_ms() == 0
    assert tracker.repeat(9 * PERIOD_MS).unchanged_ms() == 10 * PERIOD_MS


def test_source_that_sends_each_pose_twice_is_frozen_at_the_limit_when_it_stops_in_motion():
    tracker = Tracker().shake(10)
    for _ in range(100):
        tracker.move(1).repeat(PERIOD_MS)
    assert tracker.repeat(1000).is_frozen()


def test_sensors_that_rest_together_for_longer_than_known_are_frozen_at_the_limit():
    tracker = Tracker(EDGE, OTHER).shake(60, repeats=9)
    assert not tracker.repeat(1000 - 9 * PERIOD_MS).is_frozen()
    assert tracker.repeat(10 * PERIOD_MS).is_frozen()


def test_frozen_run_is_not_learned():
    tracker = Tracker().shake(200)
    for _ in range(4):
        tracker.repeat(3000).shake(50)
    assert tracker.repeat(PERIOD_MS).unchanged_ms() == PERIOD_MS


def test_history_survives_a_jump_of_the_clock():
    tracker = Tracker().shake(60, repeats=9)
    tracker.at_ms = -PERIOD_MS
    tracker.shake(3, repeats=9)
    assert tracker.unchanged_ms() == 0
    assert Tracker().shake(200).repeat(9 * PERIOD_MS).unchanged_ms() == 9 * PERIOD_MS


@settings(max_examples=25)
@given(st.lists(st.integers(0, 30), max_size=40), st.booleans(), st.integers(0, 60))
def test_no_history_delays_frozen_beyond_the_bound(runs, moves, after):
    tracker = Tracker()
    for index, repeats in enumerate(runs):
        tracker.send(100 * index if moves else index % 2).repeat(repeats * PERIOD_MS)
    tracker.shake(2).move(after)
    tracker.repeat(REST_LIMIT * 1000 + PERIOD_MS)
    assert tracker.is_frozen()
    assert tracker.unchanged_ms() >= REST_LIMIT * 1000


@given(st.integers(0, 500), st.integers(0, 500), st.integers(1, 30))
def test_probability_of_a_run_is_the_product_over_its_samples(repeats, changes, length):
    history = np.zeros(1, SENSOR_REPETITION)[0]["at_rest"]
    history["repeats"], history["changes"] = repeats, changes
    expected = np.prod([(repeats + 1 + i) / (repeats + changes + 2 + i) for i in range(length)])
    assert probability(history, 1.0, length) == pytest.approx(expected, rel=1e-9)


def test_quantised_tracker_is_never_frozen_and_its_freezes_are_detected():
    """Reference with 60 % repetitions, tool that moves and rests; 90 s."""
    recording = quantised()
    repeated, frozen, _ = clean_run(recording)
    assert repeated > len(recording.frames) / 2
    assert frozen == 0
    for moving, largest_ms in ((True, 1100), (False, 5100)):
        for at in moments(recording, moving, 5):
            found = inject(recording, at, (recording.tool,))
            assert found.frozen_ms is not None
            assert found.frozen_ms <= largest_ms
            assert found.grows_ms < 200 if moving else found.grows_ms < 1000


@pytest.mark.parametrize(
    ("name", "repeats"),
    [
        ("EightLandmarkPointsTrackedForPhantomRegistration", 9),
        ("ReferenceToRASCalibration", 1),
        ("SpinePhantomFreehand", 2),
    ],
)
def test_real_recording_is_never_frozen_and_its_freezes_are(real_recording, name, repeats):
    recording = recorded(real_recording(name))
    repeated, frozen, largest_mm = clean_run(recording)
    assert (repeated, frozen) == (repeats, 0)
    assert largest_mm < 5.0
    for at in moments(recording, True, 5):
        alone = inject(recording, at, (recording.tool,))
        assert alone.grows_ms <= 350
        assert 1000 <= alone.frozen_ms <= 1100
        whole = inject(recording, at, (recording.tool, recording.reference))
        assert whole.frozen_ms <= 350


@pytest.mark.parametrize(
    ("positions_mm", "times_ms", "moving"),
    [
        ([0.0, 0.1, 1.1, 2.1, 3.1], [0, 10, 20, 30, 40], True),
        ([0.0, 0.1, -0.3, 0.7, 1.7], [0, 10, 20, 30, 40], False),  # not straight
        ([0.0, 0.5, 1.5, 2.5, 3.5], [0, 10, 20, 30, 31], False),  # the next one is too near
    ],
)
def test_change_counts_for_the_state_before_it(positions_mm, times_ms, moving):
    sensor, still = np.zeros(1, SENSOR_REPETITION)[0], np.eye(3)
    for index, (x, at_ms) in enumerate(zip(positions_mm, times_ms, strict=True)):
        place, at_ns = np.array([x, 0.0, 0.0]), at_ms * NS_PER_MS
        if index == 0:
            keep_change(sensor, still, place, at_ns, 0.0)
        else:
            change(sensor, still, place, at_ns, LIMITS.frozen_after_ns)
    assert sensor["moving"] == moving
    change(sensor, still, np.array([x, 1.0, 0.0]), 50 * NS_PER_MS, LIMITS.frozen_after_ns)
    counts = sensor["at_rest"]["changes"], sensor["in_motion"]["changes"]
    assert counts == ((3, 2) if moving else (5, 0))
