"""Plausibility of poses: false holds in long runs, and the time in which each fault is found.

    marginguard bench plausibility [--minutes 60] [--recordings FOLDER] [--trials 40] [--json FILE]

Runs whole sessions faster than real time. A false hold is a step whose reasons contain one of the
plausibility reasons although no fault was injected. The simulated operation has 50 Hz, joints and
all kinds of configured relations; its tracker changes every minute between noise, wrong stamps,
quantisation and missing samples. Each recording below FOLDER is played once, and once twice as
fast; each of its tracked frames is the tool in turn, and the session is re-armed where it can be.
Then every fault is injected at random times and in random directions. Exit status 1 for a false
hold, and for a fault that is not found although it must be.
"""

import argparse
import json
import math
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from app.case import (
    ApproachEntry,
    BoxEntry,
    EnvelopeEntry,
    PlausibilityEntry,
    TrackingFrame,
    read_recording,
    recording_formats,
)
from app.cli.options import input_argument
from app.fixture import MarginParameters, NotRearmableError, Reason, TipProximity
from app.geometry import NS_PER_MS, NS_PER_S, InputError, Stamp, SurfaceMesh, Transform
from app.runtime import prepare_case
from app.session import Session, SessionSetup
from benchmarks.case_options import RECORDED_CASE
from benchmarks.plausibility_faults import FAULTS, Fault, injected
from benchmarks.plausibility_motion import DISTURBANCES, Disturbance, SimulatedMotion

PLAUSIBILITY_REASONS = frozenset(
    {
        Reason.IMPLAUSIBLE,
        Reason.CONTRADICTION,
        Reason.REDUNDANCY_LOST,
        Reason.REGISTRATION_DRIFT,
    }
)
RELATIONS = PlausibilityEntry(
    pairs=(EnvelopeEntry("reference", "needle", max_mm=10.0, max_rad=math.radians(10.0)),),
    workspace=BoxEntry("robot_base", (50.0, -150.0, 0.0), (350.0, 150.0, 250.0)),
    approach=ApproachEntry("robot_base", (0.0, 0.0, -1.0), (0.0, 0.0, 1.0), math.radians(90.0)),
)
"""Relations that hold throughout the simulated operation."""

SETTLE_S = 3.0
"""Time before a fault, for the noise of the sensors to be known."""

LONGEST_S = 15.0
"""Time after which a fault counts as not found."""


@dataclass(frozen=True, slots=True)
class Run:
    """Holds of one run: those by plausibility, by reason, and all others."""

    name: str
    seconds: float
    frames: int
    plausibility_holds: dict[str, int]
    other_holds: int


@dataclass(frozen=True, slots=True)
class Found:
    """How a fault was found: number of trials, times in ms and errors in mm; None if never."""

    fault: str
    sources: str
    rate_hz: int
    trials: int
    found: int
    median_ms: float | None
    max_ms: float | None
    max_error_mm: float | None


def run_session(session: Session, frames: Iterable[TrackingFrame], name: str) -> Run:
    """Step through ``frames`` and re-arm as soon as possible; counts the beginnings of holds."""
    holds: Counter[str] = Counter()
    others, count, before = 0, 0, frozenset[Reason]()
    first_ns = last_ns = 0
    held = False
    for frame in frames:
        decision = session.step(frame).decision
        first_ns, last_ns = (first_ns or frame.stamp.ns), frame.stamp.ns
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
    return Run(name, (last_ns - first_ns) / NS_PER_S, count, dict(holds), others)


def simulated_hour(motion: SimulatedMotion, minutes: float) -> Iterator[TrackingFrame]:
    """One continuous motion; the disturbance changes every minute."""
    random = np.random.default_rng(5)
    start_ns, first = 1_000 * NS_PER_S, 0
    for minute in range(math.ceil(minutes)):
        seconds = min(60.0, 60.0 * (minutes - minute))
        disturbance = DISTURBANCES[minute % len(DISTURBANCES)]
        yield from motion.frames(seconds, disturbance, random, first=first, start_ns=start_ns)
        start_ns += round(seconds * NS_PER_S)
        first += round(seconds * motion.rate_hz)


def recorded_runs(folder: Path, margins: MarginParameters, mesh: SurfaceMesh) -> Iterator[Run]:
    """Play each recording below ``folder``, with each pair of its frames as tool and tumour."""
    for path in sorted(folder.rglob("*")):
        if not path.is_file() or not any(each.recognises(path) for each in recording_formats()):
            continue
        try:
            frames = list(read_recording(path, lambda note: None))
        except InputError:
            continue  # no tracked frame, or no recording of poses
        edges = {(sample.target, sample.source) for frame in frames for sample in frame.poses}
        for target, tool in sorted(edges):
            for tumor in sorted({name for edge in edges for name in edge} - {tool}):
                if (target, tumor) not in edges and tumor != target:
                    continue
                for speed in (1, 2):
                    setup = hand_held(tool, tumor, margins, mesh)
                    name = f"{path.name}: {tool} to {tumor}" + (", twice as fast" * (speed - 1))
                    yield run_session(Session(setup), faster(frames, speed), name)


def hand_held(tool: str, tumor: str, margins: MarginParameters, mesh: SurfaceMesh) -> SessionSetup:
    """A session without a robot: the tip is the origin of ``tool``."""
    return SessionSetup(
        tool_from_tip=Transform.identity(tool, f"{tool}_tip"),
        frame_from_tumor=Transform.identity(tumor, "tumor"),
        proximity=TipProximity(mesh),
        margins=replace(margins, stale_after_ns=200 * NS_PER_MS),
        robot=None,
    )


def faster(frames: Iterable[TrackingFrame], speed: int) -> Iterator[TrackingFrame]:
    """``frames`` with intervals that are ``speed`` times shorter."""

    def scaled(stamp: Stamp) -> Stamp:
        return replace(stamp, ns=stamp.ns // speed)

    for frame in frames:
        poses = tuple(replace(sample, stamp=scaled(sample.stamp)) for sample in frame.poses)
        yield TrackingFrame(scaled(frame.stamp), poses)


def find(
    motion: SimulatedMotion,
    setup: SessionSetup,
    fault: Fault,
    sources: str,
    rate_hz: int,
    trials: int,
) -> Found:
    """Inject ``fault`` at ``trials`` times spread over the motion."""
    random = np.random.default_rng([7, rate_hz])
    times_ms, errors_mm = [], []
    for trial in range(trials):
        first = trial * motion.count // trials
        frames = motion.frames(
            SETTLE_S + LONGEST_S, Disturbance(), random, first=first, rate_hz=rate_hz
        )
        after_ns = _time_to_find(Session(setup), frames, fault, random)
        if after_ns is not None:
            times_ms.append(after_ns / NS_PER_MS)
            errors_mm.append(fault.rate_mm_s * after_ns / NS_PER_S)
    return Found(
        fault.name,
        sources,
        rate_hz,
        trials,
        len(times_ms),
        float(np.median(times_ms)) if times_ms else None,
        max(times_ms, default=None),
        max(errors_mm) if errors_mm and fault.rate_mm_s else None,
    )


def _time_to_find(
    session: Session, frames: Iterable[TrackingFrame], fault: Fault, random: np.random.Generator
) -> int | None:
    """Time from the first wrong sample to the first step with a plausibility reason."""
    from_ns = 1_000 * NS_PER_S + round(SETTLE_S * NS_PER_S)
    began_ns: int | None = None
    for frame in injected(frames, fault, from_ns, random):
        reasons = session.step(frame).decision.reasons
        if frame.stamp.ns < from_ns:
            continue
        began_ns = frame.stamp.ns if began_ns is None else began_ns
        if not PLAUSIBILITY_REASONS.isdisjoint(reasons):
            return frame.stamp.ns - began_ns
    return None


MUST_FIND = {
    "tracker alone": ("jump of 100 mm", "turn of 180 degrees", "tool and tumour swapped"),
    "tracker and joints": tuple(fault.name for fault in FAULTS if fault.name != "jump of 5 mm"),
}
"""Faults that must be found in every trial at 50 Hz."""


def failures(runs: Iterable[Run], found: Iterable[Found]) -> list[str]:
    """Missed requirements, one sentence each."""
    wrong = [
        f"{run.name}: false holds {run.plausibility_holds}; expected none"
        for run in runs
        if run.plausibility_holds
    ]
    return wrong + [
        f"{each.fault}, {each.sources}, {each.rate_hz} Hz: found in {each.found} of {each.trials}"
        for each in found
        if each.fault in MUST_FIND[each.sources] and each.rate_hz >= 50 and each.found < each.trials
    ]


def main() -> int:
    options = _options()
    prepared = prepare_case(options.case, tip_only=True)
    setup = replace(prepared.setup, plausibility=RELATIONS)
    margins, mesh = setup.margins, prepared.case.tumor_mesh()
    motion = SimulatedMotion(200)
    runs = []
    print(
        "False holds                                                   frames  plausibility  other"
    )
    for run in _runs(options, setup, motion, margins, mesh):
        runs.append(run)
        holds = ", ".join(f"{k} {n}" for k, n in run.plausibility_holds.items()) or "0"
        print(f"  {run.name:<58}{run.frames:>8}  {holds:>14}{run.other_holds:>7}", flush=True)
    found = []
    print("Injected faults                                Hz  found  median ms  max ms  error mm")
    with_joints = replace(setup, plausibility=PlausibilityEntry())
    for sources, each, rates in (
        ("tracker alone", replace(with_joints, robot=None), (20, 50, 200)),
        ("tracker and joints", with_joints, (50,)),
    ):
        for fault in FAULTS:
            for rate_hz in rates if not fault.rate_mm_s else (50,):
                result = find(motion, each, fault, sources, rate_hz, options.trials)
                found.append(result)
                print(_line(result), flush=True)
    wrong = failures(runs, found)
    if options.json is not None:
        figures = {
            "runs": [asdict(run) for run in runs],
            "faults": [asdict(each) for each in found],
        }
        options.json.write_text(json.dumps({**figures, "failures": wrong}, indent=1) + "\n")
    for sentence in wrong:
        print(sentence, file=sys.stderr)
    return 1 if wrong else 0


def _runs(
    options: argparse.Namespace,
    setup: SessionSetup,
    motion: SimulatedMotion,
    margins: MarginParameters,
    mesh: SurfaceMesh,
) -> Iterator[Run]:
    frames = simulated_hour(motion, options.minutes)
    yield run_session(Session(setup), frames, f"simulated operation, {options.minutes:g} min")
    case = prepare_case(options.case, tip_only=True)
    yield run_session(Session(case.setup), case.case.frames(), f"{options.case.name}: as recorded")
    if options.recordings is not None:
        yield from recorded_runs(options.recordings, margins, mesh)


def _line(found: Found) -> str:
    def number(value: float | None) -> str:
        return "-" if value is None else f"{value:.1f}" if value < 100.0 else f"{value:.0f}"

    share = f"{found.found}/{found.trials}"
    return (
        f"  {found.fault:<25}{found.sources:<20}{found.rate_hz:>3}{share:>7}"
        f"{number(found.median_ms):>10}{number(found.max_ms):>8}{number(found.max_error_mm):>10}"
    )


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="marginguard bench plausibility",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--minutes", type=float, default=60.0, help="simulated operation (default: 60)"
    )
    parser.add_argument("--recordings", type=input_argument, help="folder of real recordings")
    parser.add_argument("--trials", type=int, default=40, help="of each fault (default: 40)")
    parser.add_argument("--json", type=Path, help="write the figures there too")
    options = parser.parse_args()
    options.case = RECORDED_CASE
    if not 0.1 <= options.minutes <= 600.0:
        parser.error(f"--minutes is {options.minutes:g}; expected 0.1 to 600")
    if not 1 <= options.trials <= 1000:
        parser.error(f"--trials is {options.trials}; expected 1 to 1000")
    return options


if __name__ == "__main__":
    raise SystemExit(main())
