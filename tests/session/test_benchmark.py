"""Benchmark of a session step: its input, its figures, and that a step leaks no memory."""

import time
import tracemalloc
from dataclasses import replace
from itertools import repeat

import numpy as np
import pytest

from app.fixture import MarginState
from app.geometry import Stamp, TrackingStatus, Transform
from app.registration import DriftBound, given_registration
from app.session import RobotSetup, Session, SessionSetup
from benchmarks.harness.goals import missed
from benchmarks.session import FCL, LIVE, THREE, Trajectory, goals, measure
from tests.doubles import PARAMETERS, AnalyticSphere, frame, joint_sample, lost, sample

pytestmark = pytest.mark.slow

RATE_HZ = 1000


@pytest.fixture(scope="module")
def recorded(touch):
    """One second at 50 Hz: the tool approaches; one sample is lost."""
    rest = dict.fromkeys(touch.actuated_joint_names, 0.0)
    frames = []
    for k in range(51):
        at_ms = 20.0 * k
        tool = sample("tracker", "cautery", (40.0 - 0.5 * k, 0.1 * k, 0.0), at_ms)
        if k == 10:
            tool = lost("tracker", "cautery", at_ms, TrackingStatus.INVALID)
        needle = sample("tracker", "needle", (0.0, 0.0, 0.01 * k), at_ms)
        reference = sample("tracker", "reference", (0.01 * k, 0.0, 0.0), at_ms)
        joints = joint_sample({**rest, "waist": 0.01 * k, "elbow": -0.02 * k}, at_ms)
        frames.append(frame(at_ms, tool, needle, reference, joints=(joints,)))
    return frames


@pytest.fixture(scope="module")
def setup(touch):
    identity = Transform.identity
    registration = given_registration(identity("reference", "robot_base"))
    robot = RobotSetup(touch, "robot_base", "stylus", registration, DriftBound(1e4, 4.0))
    tip, tumor = identity("cautery", "cautery_tip"), identity("needle", "tumor")
    return SessionSetup(tip, tumor, AnalyticSphere(10.0), PARAMETERS, robot)


def test_recording_is_interpolated_without_lost_samples(recorded):
    frames = list(Trajectory(recorded, RATE_HZ).frames(1001))
    assert [made.stamp.ns for made in frames] == [k * 1_000_000 for k in range(1001)]
    for at_ms, x_mm in ((0, 40.0), (30, 39.25), (200, 35.0), (1000, 15.0)):
        tool, needle, _ = (pose.transform for pose in frames[at_ms].poses)
        assert tool.translation_mm[0] == pytest.approx(x_mm)
        assert needle.translation_mm[2] == pytest.approx(0.01 * at_ms / 20.0)
        joints = frames[at_ms].joints[0].as_mapping()
        moved = (joints["waist"], joints["elbow"])
        assert moved == pytest.approx(np.array([5e-4, -1e-3]) * at_ms)


def test_trajectory_reverses_at_its_end_while_time_goes_on(recorded):
    frames = list(Trajectory(recorded, RATE_HZ).frames(2500))
    assert frames[1100].poses[0].transform.translation_mm == pytest.approx(
        frames[900].poses[0].transform.translation_mm
    )
    assert frames[2499].stamp == Stamp(2_499_000_000)


def test_rotations_follow_the_shortest_arc():
    turned = Transform.from_rotation_vector(
        [0.0, 0.0, 0.4], [0.0, 0.0, 0.0], target="tracker", source="cautery"
    )
    last = replace(sample("tracker", "cautery", (0.0, 0.0, 0.0), 20.0), transform=turned)
    source = [frame(0.0, sample("tracker", "cautery", (0.0, 0.0, 0.0), 0.0)), frame(20.0, last)]
    made = list(Trajectory(source, RATE_HZ).frames(21))
    for k, at in enumerate(made):
        assert at.poses[0].transform.rotation_vector == pytest.approx([0.0, 0.0, 0.02 * k])


def test_every_step_is_counted_and_timed(recorded, setup):
    frames = Trajectory(recorded, RATE_HZ).frames(700)
    found = measure(
        {"replay": (Session(setup).step, frames), FCL: (time.sleep, repeat(1e-4))}, steps=600
    )
    assert sum(found["states"].values()) == 660  # two rounds of 22 come first
    assert found["states"][MarginState.UNKNOWN.name] == 0
    for each in found["forms"]:
        assert 0.0 < each["p50_ms"] <= each["p99_ms"] <= each["max_ms"]
    step, fcl = found["forms"]
    assert step["p99"] == pytest.approx(step["p99_ms"] / fcl["p50_ms"])
    assert (step["form"], fcl["form"], fcl["p50"]) == ("replay", FCL, 1.0)
    assert found["memory"]["warm_mb"] > 10.0


def test_slow_steps_and_growing_memory_are_failures():
    def of(live, live_p99, three, growth_mb):
        quotients = {LIVE: (live, live_p99), THREE: (three, 1.0), FCL: (1.0, 2.0)}
        forms = [{"form": name, "p50": p50, "p99": p99} for name, (p50, p99) in quotients.items()]
        return {"forms": forms, "memory": {"warm_mb": 100.0, "end_mb": 100.0 + growth_mb}}

    assert missed(goals(of(0.1, 0.4, 0.2, 0.0))) == []
    assert missed(goals(of(0.2, 0.5, 0.5, 3.5))) == [
        "p50 of live, 40 Hz, in FCL's, is 0.200; expected at most 0.15",
        "p99 of live, 40 Hz, in FCL's p50, is 0.500; expected at most 0.45",
        "p50 with three structures, in that of one, is 2.50; expected at most 2.0",
        "memory grew by 3.50 MB; expected at most 2.0 MB",
    ]


def test_thousands_of_steps_leak_no_memory(recorded, setup):
    session = Session(setup)
    frames = Trajectory(recorded, RATE_HZ).frames(3500)
    # Python keeps up to 2000 free tuples of each length; they are no leak.
    for _ in range(2000):
        session.step(next(frames))
    tracemalloc.start()
    try:
        for _ in range(500):  # replace what was made before
            session.step(next(frames))
        before, _ = tracemalloc.get_traced_memory()
        for _ in range(1000):
            session.step(next(frames))
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    # One kept reference of 8 bytes a step would be 8 kB.
    assert after - before < 4_000
