"""Whole sessions, faster than real time: false holds, and the time in which a fault is found.

A false hold is a step with one of the plausibility reasons although no fault was injected.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from app.case import (
    ApproachEntry,
    BoxEntry,
    EnvelopeEntry,
    PlausibilityEntry,
    TrackingFrame,
    read_recording,
)
from app.fixture import MarginParameters, Reason, TipProximity
from app.geometry import NS_PER_MS, NS_PER_S, Stamp, SurfaceMesh, Transform
from app.hold import NotRearmableError
from app.session import Session, SessionSetup
from tests.session.plausibility.injected_faults import FAULTS, Fault, injected
from tests.session.plausibility.simulated_motion import DISTURBANCES, Disturbance, SimulatedMotion

PLAUSIBILITY_REASONS = frozenset(
    {Reason.IMPLAUSIBLE, Reason.CONTRADICTION, Reason.REDUNDANCY_LOST, Reason.REGISTRATION_DRIFT}
)
RELATIONS = PlausibilityEntry(
    pairs=(EnvelopeEntry("reference", "needle", max_mm=10.0, max_rad=math.radians(10.0)),),
    workspace=BoxEntry("robot_base", (50.0, -150.0, 0.0), (350.0, 150.0, 250.0)),
    approach=ApproachEntry("robot_base", (0.0, 0.0, -1.0), (0.0, 0.0, 1.0), math.radians(90.0)),
)
"""Relations that hold throughout the simulated operation."""

MUST_FIND = {
    "tracker alone": ("jump of 100 mm", "turn of 180 degrees", "tool and tumour swapped"),
    "tracker and joints": tuple(fault.name for fault in FAULTS),
}
"""Faults that must be found in every trial at 50 Hz."""

SETTLE_S = 3.0
"""Time before a fault, for the noise of the sensors to be known."""

LONGEST_S = 15.0
"""Time after which a fault counts as not found."""


@dataclass(frozen=True, slots=True)
class Run:
    """Holds of one run: those by plausibility, by reason, and all others."""

    frames: int
    plausibility_holds: dict[str, int]
    other_holds: int


def run_session(setup: SessionSetup, frames: Iterable[TrackingFrame]) -> Run:
    """Step through ``frames`` and re-arm as soon as possible; counts the beginnings of holds."""
    session, holds = Session(setup), Counter[str]()
    others, count, before = 0, 0, frozenset[Reason]()
    held = False
    for frame in frames:
        decision = session.step(frame).decision
        count += 1
        found = PLAUSIBILITY_REASONS.intersection(decision.reasons)
        holds.update(str(reason) for reason in found - before)
        others += decision.hold and not held and not found
        before, held = found, decision.hold
        try:
            session.rearm()
        except NotRearmableError:
            continue
        held = False
    return Run(count, dict(holds), others)


def simulated_operation(motion: SimulatedMotion, minutes: int) -> Iterator[TrackingFrame]:
    """One continuous motion; the disturbance changes every minute."""
    random = np.random.default_rng(5)
    start_ns, first = 1_000 * NS_PER_S, 0
    for minute in range(minutes):
        disturbance = DISTURBANCES[minute % len(DISTURBANCES)]
        yield from motion.frames(60.0, disturbance, random, first=first, start_ns=start_ns)
        start_ns += 60 * NS_PER_S
        first += 60 * motion.rate_hz


def recorded_runs(path: Path, margins: MarginParameters, mesh: SurfaceMesh) -> Iterator[Run]:
    """Play a recording with each pair of its frames as tool and tumour, also twice as fast."""
    frames = list(read_recording(path, lambda note: None))
    proximity = TipProximity(mesh)
    edges = {(sample.target, sample.source) for frame in frames for sample in frame.poses}
    for target, tool in sorted(edges):
        for tumor in sorted({name for edge in edges for name in edge} - {tool}):
            if (target, tumor) in edges or tumor == target:
                for speed in (1, 2):
                    setup = _hand_held(tool, tumor, margins, proximity)
                    yield run_session(setup, _faster(frames, speed))


def _hand_held(
    tool: str, tumor: str, margins: MarginParameters, proximity: TipProximity
) -> SessionSetup:
    """A session without a robot: the tip is the origin of ``tool``."""
    return SessionSetup(
        tool_from_tip=Transform.identity(tool, f"{tool}_tip"),
        frame_from_tumor=Transform.identity(tumor, "tumor"),
        proximity=proximity,
        margins=replace(margins, stale_after_ns=200 * NS_PER_MS),
        robot=None,
    )


def _faster(frames: Iterable[TrackingFrame], speed: int) -> Iterator[TrackingFrame]:
    """``frames`` with intervals that are ``speed`` times shorter."""

    def scaled(stamp: Stamp) -> Stamp:
        return replace(stamp, ns=stamp.ns // speed)

    for frame in frames:
        poses = tuple(replace(sample, stamp=scaled(sample.stamp)) for sample in frame.poses)
        yield TrackingFrame(scaled(frame.stamp), poses)


def times_to_find(
    motion: SimulatedMotion, setup: SessionSetup, fault: Fault, trials: int
) -> list[float | None]:
    """Inject ``fault`` at ``trials`` times spread over the motion: s until it is found, or None."""
    random = np.random.default_rng([7, 50])
    return [
        _time_to_find(
            Session(setup),
            motion.frames(
                SETTLE_S + LONGEST_S, Disturbance(), random, first=trial * motion.count // trials
            ),
            fault,
            random,
        )
        for trial in range(trials)
    ]


def _time_to_find(
    session: Session, frames: Iterable[TrackingFrame], fault: Fault, random: np.random.Generator
) -> float | None:
    """Time from the first wrong sample to the first step with a plausibility reason."""
    from_ns = 1_000 * NS_PER_S + round(SETTLE_S * NS_PER_S)
    began_ns: int | None = None
    for frame in injected(frames, fault, from_ns, random):
        reasons = session.step(frame).decision.reasons
        if frame.stamp.ns < from_ns:
            continue
        began_ns = frame.stamp.ns if began_ns is None else began_ns
        if not PLAUSIBILITY_REASONS.isdisjoint(reasons):
            return (frame.stamp.ns - began_ns) / NS_PER_S
    return None


def with_sources(setup: SessionSetup, sources: str) -> SessionSetup:
    """``setup`` without relations, and without joints for the tracker alone."""
    setup = replace(setup, plausibility=PlausibilityEntry())
    return replace(setup, robot=None) if sources == "tracker alone" else setup


def faults_to_find(sources: str) -> list[Fault]:
    """The faults that must be found with these sources."""
    return [fault for fault in FAULTS if fault.name in MUST_FIND[sources]]
