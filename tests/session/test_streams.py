"""Random streams of frames into a session, and a judge of its own that says what may not be green.

The judge keeps everything that was ever sent and looks it all through at each frame: it has no tree
of poses and no counter, and shares nothing with the session but the numbers in the frames.
"""

import math
import os
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from app.case import TrackingFrame
from app.case.messages.values import PoseValues
from app.fixture import (
    FixtureDecision,
    LimiterParameters,
    MarginState,
    NotRearmableError,
    ProximityEngine,
    Reason,
    limit_twist,
)
from app.geometry import NS_PER_MS, Stamp, SurfaceMesh, TrackingStatus, Transform
from app.registration import DriftBound, register_points
from app.robot import load_robot
from app.session import RobotSetup, Session, SessionSetup
from tests.doubles import PARAMETERS, joint_sample

ROUNDS = int(os.environ.get("MARGINGUARD_TEST_ROUNDS", "1"))
"""How many times as many examples as in the suite: for a long run by hand."""

TUMOR_MM, TOOL_MM = 5.0, 1.0
"""Radii of two balls; their meshes lie inside them by `FACET_MM` together at most."""
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
    """By hand, and held by a robot whose registration is found, missing or refused."""
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


@dataclass(frozen=True)
class Sent:
    """A sample as a driver sends it: at a frame, with numbers that may be none."""

    source: str
    at_ns: int
    values: PoseValues

    @property
    def is_pose(self) -> bool:
        numbers = (*self.values.translation_m, *self.values.quaternion)
        return (
            self.values.status == TrackingStatus.OK
            and all(map(math.isfinite, numbers))
            and math.isclose(math.hypot(*self.values.quaternion), 1.0, rel_tol=1e-6)
            and max(map(abs, self.values.translation_m)) <= 10.0
        )


@dataclass
class Judge:
    """What DESIGN section 4 asks of the frames sent so far."""

    sources: tuple[str, ...]
    registered: bool
    frames_ns: list[int] = field(default_factory=list)
    sent: list[Sent] = field(default_factory=list)
    bad: list[bool] = field(default_factory=list)
    held: bool = False

    def see(self, now_ns: int, sent: list[Sent]) -> None:
        jumped = bool(self.frames_ns) and now_ns < self.frames_ns[-1]
        self.frames_ns.append(now_ns)
        self.sent += sent
        begin = self._since_jump()
        bad = jumped or not self.registered
        # Nothing looked while the last known margin became too old.
        if len(self.frames_ns) > 1 and not self.is_unknown():
            bad |= now_ns - self.frames_ns[-2] > PARAMETERS.stale_after_ns
        bad |= any(self._is_bad(source, now_ns, begin) for source in self.sources)
        self.held |= bad and not all(self.bad)
        self.bad.append(bad)

    def is_unknown(self) -> bool:
        """Until a first good frame, and until enough good ones in a row after a bad one."""
        if all(self.bad):
            return True
        first = self.bad.index(False)
        return any(self.bad[first:][-PARAMETERS.release_samples :])

    def latest(self, source: str) -> PoseValues:
        return self._taken(source, self._since_jump())[-1].values

    def _since_jump(self) -> int:
        """The index of the first frame since the clock last went back."""
        frames = self.frames_ns
        return max((i for i in range(1, len(frames)) if frames[i] < frames[i - 1]), default=0)

    def _taken(self, source: str, begin: int) -> list[Sent]:
        """Samples of the present run of the clock, less those that came after newer ones."""
        taken: list[Sent] = []
        for sample in self.sent:
            if sample.source != source or sample.at_ns < begin:
                continue
            now_ns = self.frames_ns[sample.at_ns]
            if taken and sample.values.ns < taken[-1].values.ns <= now_ns:
                continue
            taken.append(sample)
        return taken

    def _is_bad(self, source: str, now_ns: int, begin: int) -> bool:
        taken = self._taken(source, begin)
        if not taken or not taken[-1].is_pose:
            return True
        age_ns = now_ns - taken[-1].values.ns
        if not 0 <= age_ns <= PARAMETERS.stale_after_ns:
            return True
        poses = [sample for sample in taken if sample.is_pose]
        same = [numbers_of(pose.values) == numbers_of(poses[-1].values) for pose in poses]
        run = poses[len(poses) - [*same[::-1], False].index(False) :]
        # A pose was there when its frame was, whatever later time it was stamped with.
        since_ns = min(run[0].values.ns, self.frames_ns[run[0].at_ns])
        return run[-1].values.ns - since_ns > PARAMETERS.frozen_after_ns


def numbers_of(values: PoseValues) -> tuple[float, ...]:
    return (*values.translation_m, *values.quaternion)


ODD = {
    "nan": {"translation_m": (math.nan, 0.0, 0.0)},
    "infinite": {"quaternion": (0.0, 0.0, 0.0, math.inf)},
    "scaled": {"quaternion": (0.0, 0.0, 0.0, 1.1)},
    "no rotation": {"quaternion": (0.0, 0.0, 0.0, 0.0)},
    "far away": {"translation_m": (0.0, -3.7e25, 0.0)},
    **{status.name: {"status": int(status)} for status in TrackingStatus if status},
    "unheard of": {"status": 99},
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
"""What each sensor sends, how far the tool is from the tumour, and what the operator does."""
CALM = {"advance_ms": 20, "joints": "absent", "distance_mm": 40.0, "rearm": False}
GOOD: dict[str, Any] = {**CALM, **dict.fromkeys(("needle", "cautery", "reference"), "fresh")}
# Long runs of one thing are what freezing and releasing are made of; single frames seldom make one.
STORIES = st.lists(
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
    """Makes frames of events; a fresh pose never repeats another digit for digit."""

    sources: tuple[str, ...]
    now_ns: int = 10**13
    count: int = 0
    last: dict[str, PoseValues] = field(default_factory=dict)

    def frame(self, event: dict[str, Any]) -> tuple[TrackingFrame, list[Sent]]:
        self.now_ns += event["advance_ms"] * NS_PER_MS
        self.count += 1
        jitter_mm = 1e-6 * self.count
        needle_mm = np.array([10.0 + jitter_mm, 20.0, 30.0])
        tip_mm = needle_mm + CENTRE_MM + [event["distance_mm"], 0.0, 0.0]
        places = {
            "needle": needle_mm,
            "cautery": tip_mm - TIP_MM,
            "reference": np.array([1.0, 2.0, 3.0 + jitter_mm]),
        }
        sent = []
        for source in self.sources:
            values = self._arrival(source, event[source], places[source])
            if values is not None:
                sent.append(Sent(source, self.count - 1, values))
        samples = tuple(one.values.sample() for one in sent)
        return TrackingFrame(Stamp(self.now_ns), samples, self._joints(event["joints"])), sent

    def _arrival(self, source: str, how: str, place_mm: np.ndarray) -> PoseValues | None:
        repeated = how.startswith("repeated")
        if how == "absent" or (repeated and source not in self.last):
            return None
        fresh = PoseValues(
            "tracker", source, self.now_ns, tuple(place_mm / 1000.0), (0.0, 0.0, 0.0, 1.0)
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
        return (joint_sample({"waist": value}, self.now_ns / NS_PER_MS + shift_ms),)


def clearance_mm(judge: Judge) -> float:
    """Between the two balls, from the numbers that were sent."""
    needle, cautery = (
        1000.0 * np.array(judge.latest(source).translation_m) for source in ("needle", "cautery")
    )
    return float(np.linalg.norm(cautery + TIP_MM - needle - CENTRE_MM)) - TUMOR_MM - TOOL_MM


def check(decision: FixtureDecision, judge: Judge) -> None:
    unknown = decision.state is MarginState.UNKNOWN
    assert unknown == judge.is_unknown()
    assert decision.hold == (unknown or judge.held)
    assert (Reason.LATCHED in decision.reasons) == judge.held
    assert any(reason.is_fault for reason in decision.reasons) == unknown
    if decision.constraint is None:
        assert decision.hold
    else:
        assert decision.constraint.hold == decision.hold
    if judge.bad[-1] and decision.constraint is not None:
        normal = decision.constraint.normals[0]
        origin = decision.constraint.points_on_tool_mm[0]
        toward = np.concatenate([-50.0 * normal, np.zeros(3)])
        allowed = limit_twist(toward, decision.constraint, origin, LimiterParameters())
        assert float(allowed[:3] @ normal) >= -1e-6
    if unknown:
        return
    gap_mm = clearance_mm(judge)
    oldest_ns = min(judge.latest(source).ns for source in judge.sources)
    age_s = (judge.frames_ns[-1] - oldest_ns) * 1e-9
    assert decision.stamp == Stamp(oldest_ns)
    if decision.state is not MarginState.POSITIVE:
        assert gap_mm > -FACET_MM
    if decision.state is MarginState.NEGATIVE:
        warn_mm = PARAMETERS.warn_mm + PARAMETERS.v_max_mm_s * age_s
        assert gap_mm >= warn_mm - FACET_MM


@pytest.mark.parametrize("held_by", ["hand", "found", "missing", "refused"])
@settings(max_examples=40 * ROUNDS, derandomize=ROUNDS == 1)
@given(story=STORIES)
def test_nothing_is_green_that_a_judge_calls_bad(engine, robots, held_by, story):
    robot = robots[held_by]
    sources = ("needle", "cautery") if robot is None else ("needle", "cautery", "reference")
    setup = SessionSetup(
        Transform("cautery", "cautery_tip", np.eye(3), TIP_MM),
        Transform("needle", "tumor", np.eye(3), CENTRE_MM),
        engine,
        PARAMETERS,
        robot,
    )
    session, stream = Session(setup), Stream(sources)
    judge = Judge(sources, registered=held_by in ("hand", "found"))
    for event in story:
        frame, sent = stream.frame(event)
        judge.see(stream.now_ns, sent)
        check(session.step(frame).decision, judge)
        if event["rearm"] and judge.is_unknown():
            with pytest.raises(NotRearmableError):
                session.rearm()
        elif event["rearm"]:
            session.rearm()
            judge.held = False
