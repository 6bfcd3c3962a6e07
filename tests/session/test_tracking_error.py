"""Latency and errors of a tracker in the margin, against simulated errors and known times."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.case import TrackingFrame
from app.fixture import (
    Constraint,
    LimiterParameters,
    MarginState,
    Reason,
    TumorMotionParameters,
    limit_twist,
)
from app.geometry import NS_PER_MS, InputError, Stamp, Transform
from app.session import LiveSession, Session, SessionSetup, TrackingError
from tests.doubles import PARAMETERS, AnalyticSphere, frame, sample

pytestmark = pytest.mark.slow

LATENCY_MS = 20


def make_setup(**changes) -> SessionSetup:
    return replace(
        SessionSetup(
            Transform.identity("cautery", "cautery_tip"),
            Transform.identity("needle", "tumor"),
            AnalyticSphere(10.0),
            PARAMETERS,
            None,
        ),
        **changes,
    )


def test_sigma_is_the_spread_of_simulated_errors():
    error = TrackingError(sigma_mm=0.3, sigma_rad=0.01)
    tool_mm, tumor_mm = np.array([0.0, 60.0, 0.0]), np.array([0.0, 0.0, 25.0])
    rng = np.random.default_rng(0)
    count = 20_000
    off = np.zeros((count, 3))
    for point in (tool_mm, tumor_mm):
        turned = Rotation.from_rotvec(rng.normal(scale=0.01, size=(count, 3))).apply(point)
        off += rng.normal(scale=0.3, size=(count, 3)) + turned - point
    # Rotations move a point across its lever only: x is across both.
    spread = off.std(axis=0)
    assert error.sigma_between(60.0, 25.0) == pytest.approx(spread[0], rel=0.02)
    assert (spread <= 1.02 * error.sigma_between(60.0, 25.0)).all()


def test_tracker_without_known_errors_adds_nothing():
    assert TrackingError().sigma_between(100.0, 100.0) == 0.0
    taken = frame(100, sample("needle", "cautery", (50.0, 0.0, 0.0), 90))
    assert TrackingError().acquired(taken) is taken


@pytest.mark.parametrize("name", ["latency_ns", "sigma_mm", "sigma_rad"])
@pytest.mark.parametrize("value", [-1, math.nan, math.inf])
def test_invalid_error_is_refused(name, value):
    with pytest.raises(InputError, match=name):
        TrackingError(**{name: value})


def test_margin_contains_sigma_of_the_farthest_witness():
    """The tip is 50 mm from both sensors' origins; its distance from them is the lever."""
    error = TrackingError(sigma_mm=0.2, sigma_rad=0.002)
    tip = Transform("cautery", "cautery_tip", np.eye(3), np.array([0.0, 0.0, 30.0]))
    session = Session(make_setup(tracking=error, tool_from_tip=tip))
    step = session.step(frame(100, sample("needle", "cautery", (40.0, 0.0, 0.0), 100)))
    proximity, margin = step.decision.proximity, step.decision.margin
    assert proximity.on_tool_mm == pytest.approx([40.0, 0.0, 30.0])
    variance = 2 * 0.2**2 + 0.002**2 * (30.0**2 + 50.0**2)
    assert margin.tre_mm == pytest.approx(PARAMETERS.k_tre * math.sqrt(variance))


def step_after(latency_ms: float, age_ms: float, *, stamps_of_host: bool = True):
    """The step of a live session whose newest sample has arrived and is ``age_ms`` old."""
    host = [1_000_000 * NS_PER_MS]
    setup = make_setup(tracking=TrackingError(latency_ns=round(latency_ms * NS_PER_MS)))
    live = LiveSession(Session(setup), host_ns=lambda: host[0], stamps_of_host=stamps_of_host)
    for _ in range(5):
        host[0] += 20 * NS_PER_MS
        live.add([sample("needle", "cautery", (50.0, 0.0, 0.0), host[0] / NS_PER_MS)])
    host[0] += round(age_ms * NS_PER_MS)
    steps = live.steps()
    return next(steps)


@pytest.mark.parametrize("stamps_of_host", [True, False])
def test_latency_is_part_of_the_age(stamps_of_host):
    known = step_after(LATENCY_MS, 5.0, stamps_of_host=stamps_of_host).decision
    unknown = step_after(0.0, 5.0, stamps_of_host=stamps_of_host).decision
    more_mm = PARAMETERS.v_max_mm_s * LATENCY_MS / 1000.0
    assert known.margin.age_mm == pytest.approx(unknown.margin.age_mm + more_mm)
    assert known.stamp.ns == unknown.stamp.ns - LATENCY_MS * NS_PER_MS


def test_pose_is_stale_by_its_acquisition():
    limit_ms = PARAMETERS.stale_after_ns / NS_PER_MS
    assert step_after(LATENCY_MS, limit_ms - LATENCY_MS - 1.0).decision.state is not (
        MarginState.UNKNOWN
    )
    late = step_after(LATENCY_MS, limit_ms - LATENCY_MS + 1.0).decision
    assert late.state is MarginState.UNKNOWN
    assert Reason.STALE in late.reasons


def test_stamp_from_the_future_is_not_hidden_by_the_latency():
    error = TrackingError(latency_ns=LATENCY_MS * NS_PER_MS)
    ahead = sample("needle", "cautery", (50.0, 0.0, 0.0), 101)
    present = sample("tracker", "needle", (0.0, 0.0, 0.0), 100)
    found = error.acquired(TrackingFrame(Stamp(100 * NS_PER_MS), (ahead, present)))
    assert [each.stamp.ns for each in found.poses] == [101 * NS_PER_MS, 80 * NS_PER_MS]
    step = Session(make_setup(tracking=error)).step(error.acquired(frame(100, ahead)))
    assert Reason.FUTURE_STAMP in step.decision.reasons


def test_velocity_of_the_tumour_in_a_frame_of_the_tracker_needs_no_robot():
    motion = TumorMotionParameters(5.0, 0.01, 0.25, 0.1, 0.001)
    with pytest.raises(InputError, match="without a robot"):
        make_setup(tumor_motion=motion)
    session = Session(make_setup(tumor_motion=motion, motion_frame="tracker"))
    pace = 2.0 * math.pi * 0.25
    off = []
    for at_ms in np.arange(0.0, 6000.0, 20.0):
        z = 5.0 * math.sin(pace * at_ms / 1000.0)
        needle = sample("tracker", "needle", (0.0, 0.0, z), at_ms)
        tool = sample("tracker", "cautery", (60.0, 0.001 * at_ms, 0.0), at_ms)
        found = session.step(frame(at_ms, needle, tool)).decision.constraint
        true = 5.0 * pace * math.cos(pace * at_ms / 1000.0)
        off.append(found.tumor_velocities_mm_s[0] - [0.0, 0.0, true])
    assert np.abs(off[50:]).max() < 1.0  # it moves at up to 7.9 mm/s


def lowest_distance_mm(*, known_ms: float, sigma_mm: float, follows: bool) -> float:
    """Lowest true distance while a hand pushes a tool for 4.2 s at a tumour that breathes along z.

    The tracker samples every 20 ms with a latency of 20 ms, and measures 2 * 0.25 mm too much. The
    controller sets the tool's velocity every 4 ms. The margin knows ``known_ms`` of the latency and
    ``sigma_mm``; the velocity of the tumour is exact, or unknown.
    """
    parameters = replace(PARAMETERS, v_max_mm_s=100.0)
    limits = LimiterParameters(tau_s=0.1)
    height_mm, velocity_mm_s, pace = 40.0, 0.0, 2.0 * math.pi * 0.25
    top = [4.5 * math.sin(pace * at / 1000.0) for at in range(4201)]  # of the tumour, each ms
    heights, lowest = [], math.inf
    for at in range(4200):
        heights.append(height_mm)
        acquired = at - LATENCY_MS - at % 20  # of the newest sample that has arrived
        if acquired >= 0 and at % 4 == 0:
            margin = parameters.applied(sigma_mm, round((at % 20 + known_ms) * NS_PER_MS))
            clearance = heights[acquired] - top[acquired] + 0.5 - margin.total_mm
            speed = 4.5 * pace * math.cos(pace * at / 1000.0) if follows else 0.0
            planes = Constraint(
                "tumor", [[0, 0, 1]], [-clearance], [[0, 0, 0]], [[0, 0, speed]], hold=False
            )
            desired = np.array([0.0, 0.0, -100.0, 0.0, 0.0, 0.0])
            velocity_mm_s = float(limit_twist(desired, planes, np.zeros(3), limits)[2])
        height_mm += velocity_mm_s / 1000.0
        lowest = min(lowest, height_mm - top[at + 1])
    return lowest


def test_pushed_tool_keeps_the_margin_from_a_breathing_tumour():
    complete = lowest_distance_mm(known_ms=LATENCY_MS, sigma_mm=0.25, follows=True)
    assert complete >= PARAMETERS.stop_mm
    nothing = lowest_distance_mm(known_ms=0.0, sigma_mm=0.0, follows=False)
    assert nothing < PARAMETERS.stop_mm - 0.2
    # Each of the three terms keeps the tool farther away, by about its size.
    rows = {
        "latency": ({"known_ms": 0.0, "sigma_mm": 0.25, "follows": True}, 100.0 * 0.020),
        "sigma": ({"known_ms": LATENCY_MS, "sigma_mm": 0.0, "follows": True}, 2.0 * 0.25),
        "velocity": (
            {"known_ms": LATENCY_MS, "sigma_mm": 0.25, "follows": False},
            0.1 * 4.5 * 1.57,
        ),
    }
    for name, (keys, size_mm) in rows.items():
        assert complete - lowest_distance_mm(**keys) == pytest.approx(size_mm, rel=0.15), name
