"""A sudden change of the difference between tracker and joints: found with its second sample."""

import numpy as np
import pytest
from scipy.signal import lfilter

from app.geometry import NS_PER_S
from app.session.joint_check import GAP_NS, SUDDEN_CHANGE, change_text, update_change
from app.session.relations import ENDS_AFTER_NS
from app.session.sensor_motion import MAX_SIGMA_MM

pytestmark = pytest.mark.slow

LIMIT_MM = 2.5
REST = np.array([10.0, 20.0, 30.0])
JUMP = np.array([4.0, 0.0, 0.0])


class Run:
    """Feeds a `SUDDEN_CHANGE`; ``found`` are the numbers of the samples with a finding."""

    def __init__(self, rate_hz: float = 50.0) -> None:
        self.change = np.zeros(1, SUDDEN_CHANGE)[0]
        self.change["limit_mm"], self.change["variance"] = LIMIT_MM, MAX_SIGMA_MM**2
        self.period_ns = round(NS_PER_S / rate_hz)
        self.ns = 0
        self.number = -1
        self.found: list[int] = []
        self.start = np.zeros(3)

    @property
    def text(self):
        return change_text(self.change) if self.change["found"] else ""

    def add(self, differences, predicted=None):
        differences = np.atleast_2d(differences)
        predicted = np.broadcast_to(REST if predicted is None else predicted, differences.shape)
        for difference, place in zip(differences, predicted, strict=True):
            self.ns += self.period_ns
            self.number += 1
            tracked = tuple((place + difference).tolist())
            update_change(self.change, tracked, tuple(place.tolist()), self.start, self.ns)
            if self.text:
                self.found.append(self.number)
        return self


def white(seed: int, sigma_mm: float, count: int):
    return np.random.default_rng(seed).normal(0.0, sigma_mm, (count, 3))


@pytest.mark.parametrize("rate_hz", [15.0, 50.0, 200.0])
@pytest.mark.parametrize("error_mm", [-3.0, 0.0, 1.0])
def test_jump_is_found_with_its_second_sample_whatever_the_registration_error(rate_hz, error_mm):
    error = np.array([error_mm, 0.0, 0.0])
    for seed in range(20):
        run = Run(rate_hz).add(error + white(seed, 0.25, 150))
        assert run.found == []
        run.add(error + JUMP + white(seed + 100, 0.25, 2))
        assert run.found[-1] == 151


def test_jump_of_an_exact_tracker_at_rest_is_found_with_its_second_sample():
    run = Run().add(np.zeros((150, 3)))
    assert run.add([JUMP]).found == []
    assert run.add([JUMP]).found == [151]


def test_noise_of_a_quiet_tracker_is_learned_and_leaves_the_limit():
    run = Run().add(white(1, 0.25, 150))
    assert run.add([0.8 * JUMP] * 2).found == [151]


def test_one_wrong_sample_is_no_change():
    differences = np.zeros((500, 3))
    differences[200::50, 0] = 4.9
    assert Run().add(differences).found == []


@pytest.mark.parametrize("rate_hz", [20.0, 200.0])
@pytest.mark.parametrize("sigma_mm", [0.3, 0.6])
@pytest.mark.parametrize("time_constant_s", [0.0, 0.04, 0.08])
def test_correlated_noise_is_no_change(rate_hz, sigma_mm, time_constant_s):
    noise = white(4, sigma_mm, round(300 * rate_hz))
    if time_constant_s:
        keep = np.exp(-1.0 / (rate_hz * time_constant_s))
        noise = lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], noise, axis=0)
    assert Run(rate_hz).add(noise).found == []


@pytest.mark.parametrize("speed_mm_s", [50.0, 200.0, 500.0])
def test_error_of_the_clocks_is_no_change_when_the_tool_begins_to_move(speed_mm_s):
    """The joints are 15 ms late; the tool reaches its speed within 0.1 s, and stops."""
    times = np.arange(0.0, 4.0, 0.02)

    def place(at_s):
        ramp = np.clip(at_s - 2.5, 0.0, 1.0)
        return REST + np.outer(speed_mm_s * (ramp - 0.1 * np.tanh(10.0 * ramp)), (0.0, 1.0, 0.0))

    late = place(times - 0.015)
    assert Run().add(place(times) - late + white(2, 0.15, len(times)), late).found == []


def test_pose_that_a_driver_repeats_in_motion_is_not_used():
    """Every second pose is sent twice: 150 mm/s within 20 ms are 3 mm."""
    times = np.arange(0.0, 4.0, 0.02)
    predicted = REST + np.outer(150.0 * np.maximum(times - 2.5, 0.0), (1.0, 0.0, 0.0))
    repeated = predicted[np.arange(len(times)) // 2 * 2]
    assert Run().add(repeated - predicted, predicted).found == []


@pytest.mark.parametrize("back_to", [(-3.0, 0.0, 0.0), (0.0, 0.0, 0.0)], ids=["before", "start"])
def test_change_ends_half_a_second_after_the_difference_is_back(back_to):
    crept = np.array([-3.0, 0.0, 0.0])
    run = Run().add(crept + white(1, 0.1, 150))
    run.add(crept + 2.0 * JUMP + white(2, 0.1, 500))
    assert run.text
    held = round(ENDS_AFTER_NS / run.period_ns)
    assert run.add(white(3, 0.1, held) + back_to).text
    assert not run.add(white(4, 0.1, 4) + back_to).text
    assert not run.add(white(5, 0.1, 200) + back_to).text


def test_neither_silence_nor_a_clock_that_is_set_back_ends_a_change():
    run = Run().add(np.zeros((150, 3))).add([JUMP, JUMP])
    for shift_ns in (10 * NS_PER_S, -8 * NS_PER_S):
        run.ns += shift_ns
        assert run.add([JUMP] * 100).text


def test_differences_that_are_far_apart_are_not_compared():
    run = Run().add(np.zeros((150, 3)))
    run.ns += GAP_NS
    assert run.add([JUMP] * 50).found == []
