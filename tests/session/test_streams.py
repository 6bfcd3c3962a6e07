"""Random streams of frames into a session, checked against an independent oracle."""

import math
import os
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from app.case import MotionEntry, PlausibilityEntry, TrackingFrame
from app.case.messages.message_values import PoseValues
from app.fixture import (
    FixtureDecision,
    LimiterParameters,
    MarginState,
    ProximityEngine,
    Reason,
    limit_twist,
)
from app.geometry import NS_PER_MS, Stamp, SurfaceMesh, TrackingStatus, Transform
from app.hold import NotRearmableError
from app.registration import DriftBound, register_points
from app.robot import load_robot
from app.session import RobotSetup, Session, SessionSetup
from tests.doubles import PARAMETERS, joint_sample
from tests.oracles.margin_trust import MarginTrustOracle, SentSample

pytestmark = pytest.mark.slow

ROUNDS = int(os.environ.get("MARGINGUARD_TEST_ROUNDS", "1"))
"""Factor on the number of examples, for a long run by hand."""

TUMOR_MM, TOOL_MM = 5.0, 1.0
"""Radii of two balls; their meshes lie inside them, together by `FACET_MM` at most."""
FACET_MM = 0.3
TIP_MM = np.array([0.0, 0.0, 70.0])
CENTRE_MM = np.array([5.0, -4.0, 30.0])
STEP_NS = 20 * NS_PER_MS


def ball(radius_mm: float, frame: str) -> SurfaceMesh:
    made = trimesh.creation.icosphere(2, radius=radius_mm)
    return SurfaceMesh(frame, made.vertices, made.faces)


@pytest.fixture(scope="module")
def engine() -> ProximityEngine:
    return ProximityEngine(
        ball(TUMOR_MM, "tumor"), ball(TOOL_MM, "cautery_tip"), field_nodes=20_000
    )


@pytest.fixture(scope="module")
def robots(project_root) -> dict[str, RobotSetup | None]:
    """No robot, and robots whose registration is found, missing or refused."""
    touch = load_robot(project_root / "data" / "robots" / "touch" / "touch.urdf")
    points = np.random.default_rng(5).uniform(-60.0, 60.0, (8, 3))
    noisy = points + np.random.default_rng(6).normal(0.0, 0.1, points.shape)
    found = register_points(noisy, points, fixed_frame="reference", moving_frame="robot_base")
    robot = RobotSetup(touch, "robot_base", "stylus", found, DriftBound(1e6, 10.0))
    refused = replace(found, accepted=False, reason="refused by the test")
    return {
        "hand": None,
        "found": robot,
        "missing": replace(robot, registration=None),
        "refused": replace(robot, registration=refused),
    }


ODD = {
    "nan": {"translation_m": (math.nan, 0.0, 0.0)},
    "infinite": {"quaternion": (0.0, 0.0, 0.0, math.inf)},
    "scaled": {"quaternion": (0.0, 0.0, 0.0, 1.1)},
    "no rotation": {"quaternion": (0.0, 0.0, 0.0, 0.0)},
    "far away": {"translation_m": (0.0, -3.7e25, 0.0)},
    **{status.name: {"status": int(status)} for status in TrackingStatus if status},
    "unknown status": {"status": 99},
}
ARRIVALS = st.one_of(
    st.sampled_from(["fresh"] * 12),
    st.sampled_from(
        ["absent", "repeated", "repeated early", "late", "early", "very early", "old", *ODD]
    ),
)
JOINTS = ["absent", "fresh", "old", "early", "nan"]
FRAMES = st.fixed_dictionaries(
    {
        "advance_ms": st.one_of(
            st.just(20), st.sampled_from([0, 1, 150, 201, 400, 5000, -1, -500, -(10**7)])
        ),
        "needle": ARRIVALS,
        "cautery": ARRIVALS,
        "reference": ARRIVALS,
        "joints": st.sampled_from(JOINTS),
        "distance_mm": st.one_of(st.just(40.0), st.floats(2.0, 60.0)),
        "rearm": st.booleans(),
    }
)
"""Per frame: what each sensor sends, the distance of the tool, and whether the operator re-arms."""
FAST = PlausibilityEntry(motion=MotionEntry(1e9, 1e12, 1e9, 1e12))
"""Limits of motion that no event exceeds: `tests/session/plausibility` tests them."""
CALM = {"advance_ms": 20, "joints": "fresh", "distance_mm": 40.0, "rearm": False}
GOOD: dict[str, Any] = {**CALM, **dict.fromkeys(("needle", "cautery", "reference"), "fresh")}
# Freezing and releasing need runs of equal events, which single frames seldom form.
SCENARIOS = st.lists(
    st.one_of(
        FRAMES.map(lambda one: [one]),
        st.integers(1, 4).map(lambda n: [GOOD] * n),
        st.tuples(st.sampled_from(["needle", "cautery", "reference"]), st.integers(5, 10)).map(
            lambda stuck: [{**GOOD, "advance_ms": 150, stuck[0]: "repeated"}] * stuck[1]
        ),
        st.sampled_from(["needle", "cautery", "reference"]).map(
            lambda source: (
                [{**GOOD, source: "very early"}]
                + [{**GOOD, "advance_ms": 150, source: "repeated"}] * 9
            )
        ),
    ),
    min_size=1,
    max_size=12,
).map(lambda parts: [one for part in parts for one in part])


@dataclass
class Stream:
    """Builds frames from events; a fresh pose never repeats the values of another."""

    sources: tuple[str, ...]
    joint_names: tuple[str, ...] = ()
    now_ns: int = 10**13
    count: int = 0
    last: dict[str, PoseValues] = field(default_factory=dict)

    def frame(self, event: dict[str, Any]) -> tuple[TrackingFrame, list[SentSample]]:
        self.now_ns += event["advance_ms"] * NS_PER_MS
        self.count += 1
        jitter_mm = 1e-6 * self.count
        needle_mm = np.array([10.0 + jitter_mm, 20.0, 30.0])
        tip_mm = needle_mm + CENTRE_MM + [event["distance_mm"], 0.0, 0.0]
        positions_mm = {
            "needle": needle_mm,
            "cautery": tip_mm - TIP_MM,
            "reference": np.array([1.0, 2.0, 3.0 + jitter_mm]),
        }
        sent = []
        for source in self.sources:
            values = self._arrival(source, event[source], positions_mm[source])
            if values is not None:
                sent.append(SentSample(source, self.count - 1, values))
        samples = tuple(one.values.sample() for one in sent)
        return TrackingFrame(Stamp(self.now_ns), samples, self._joints(event["joints"])), sent

    def _arrival(self, source: str, how: str, position_mm: np.ndarray) -> PoseValues | None:
        repeated = how.startswith("repeated")
        if how == "absent" or (repeated and source not in self.last):
            return None
        fresh = PoseValues(
            "tracker", source, self.now_ns, tuple(position_mm / 1000.0), (0.0, 0.0, 0.0, 1.0)
        )
        if repeated:
            shift_ns = 10**4 * NS_PER_MS if how == "repeated early" else 0
            return self.last[source]._replace(ns=self.now_ns + shift_ns)
        shift_ms = {"late": -30, "early": 1, "very early": 10**6, "old": -201}.get(how, 0)
        values = fresh._replace(ns=self.now_ns + shift_ms * NS_PER_MS, **ODD.get(how, {}))
        if how not in ODD:
            self.last[source] = values
        return values

    def _joints(self, how: str):
        shift_ms = {"fresh": 0, "old": -500, "early": 500, "nan": 0}.get(how)
        if shift_ms is None:
            return ()
        value = math.nan if how == "nan" else 0.2
        values = dict.fromkeys(self.joint_names, 0.2) | {"waist": value}
        return (joint_sample(values, self.now_ns / NS_PER_MS + shift_ms),)


def clearance_mm(oracle: MarginTrustOracle) -> float:
    """Distance in mm between the two balls, computed from the sent numbers."""
    needle, cautery = (
        1000.0 * np.array(oracle.latest(source).translation_m) for source in ("needle", "cautery")
    )
    return float(np.linalg.norm(cautery + TIP_MM - needle - CENTRE_MM)) - TUMOR_MM - TOOL_MM


def check(decision: FixtureDecision, oracle: MarginTrustOracle) -> None:
    unknown = decision.state is MarginState.UNKNOWN
    assert unknown == oracle.is_unknown()
    assert decision.hold == (unknown or oracle.held)
    assert (Reason.LATCHED in decision.reasons) == oracle.held
    assert any(reason.is_fault for reason in decision.reasons) == unknown
    if decision.constraint is None:
        assert decision.hold
    else:
        assert decision.constraint.hold == decision.hold
    if oracle.bad[-1] and decision.constraint is not None:
        normal = decision.constraint.normals[0]
        origin = decision.constraint.points_on_tool_mm[0]
        toward = np.concatenate([-50.0 * normal, np.zeros(3)])
        allowed = limit_twist(toward, decision.constraint, origin, LimiterParameters())
        assert float(allowed[:3] @ normal) >= -1e-6
    if unknown:
        return
    gap_mm = clearance_mm(oracle)
    oldest_ns = min(oracle.latest(source).ns for source in oracle.sources)
    age_s = (oracle.frames_ns[-1] - oldest_ns) * 1e-9
    assert decision.stamp == Stamp(oldest_ns)
    if decision.state is not MarginState.POSITIVE:
        assert gap_mm > -FACET_MM
    if decision.state is MarginState.NEGATIVE:
        warn_mm = PARAMETERS.warn_mm + PARAMETERS.v_max_mm_s * age_s
        assert gap_mm >= warn_mm - FACET_MM


@pytest.mark.parametrize("held_by", ["hand", "found", "missing", "refused"])
@settings(max_examples=40 * ROUNDS, derandomize=ROUNDS == 1)
@given(scenario=SCENARIOS)
def test_no_state_is_green_that_the_oracle_rejects(engine, robots, held_by, scenario):
    robot = robots[held_by]
    sources = ("needle", "cautery") if robot is None else ("needle", "cautery", "reference")
    setup = SessionSetup(
        Transform("cautery", "cautery_tip", np.eye(3), TIP_MM),
        Transform("needle", "tumor", np.eye(3), CENTRE_MM),
        engine,
        PARAMETERS,
        robot,
        plausibility=FAST,
    )
    names = () if robot is None else tuple(robot.robot.actuated_joint_names)
    session, stream = Session(setup), Stream(sources, names)
    oracle = MarginTrustOracle(
        sources, registered=held_by in ("hand", "found"), checked_by_joints=held_by == "found"
    )
    for event in scenario:
        frame, sent = stream.frame(event)
        oracle.observe(stream.now_ns, sent, frame.joints)
        check(session.step(frame).decision, oracle)
        if event["rearm"] and oracle.is_unknown():
            with pytest.raises(NotRearmableError):
                session.rearm()
        elif event["rearm"]:
            session.rearm()
            oracle.held = False
