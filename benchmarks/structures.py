"""Time of a session's step with few and with many structures, beside FCL's broad phase.

A cautery moves around a lobed tumour at 1 kHz and at times enters it. A second structure lies
beside it, all others 200 to 300 mm away around both. Sessions that measure all, sessions that do
not measure what is far, as `marginguard live` does, and FCL's dynamic AABB tree of the same meshes
take each pose in turn. Times are processor times of the thread.
"""

import gc
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from app.case import TrackingFrame
from app.cli.progress import with_progress
from app.fixture import MarginParameters, ProximityEngine
from app.geometry import NS_PER_S, FloatArray, Stamp, SurfaceMesh, TrackedTransform, Transform
from app.session import Session, SessionSetup, Structure
from benchmarks.fixture.case import RATE_HZ, Case
from benchmarks.fixture.engines import fcl_object
from benchmarks.harness.figures import columns_table, show, spread
from benchmarks.harness.goals import Goal, at_most, finish
from benchmarks.harness.options import BenchParser
from benchmarks.harness.plots import write_lines

TOOL_TRIANGLES = 2000
MOST_P99 = {20: 1.5, 100: 2.0}
"""Most of the 99th percentile by number of structures, in that of the nearest two alone."""

MARGINS = MarginParameters(1.0, 5.0, 2.0, 50.0, 75_000_000, 3, 0.5, NS_PER_S)
LIVE, ALL, FCL = "session, live", "session, all measured", "FCL, broad phase"


def places_mm(count: int) -> list[FloatArray]:
    """Centres: the tumour's, that of one beside it, the others on a spiral around both."""
    turns = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0))
    heights = np.linspace(-0.9, 0.9, count)
    ways = np.column_stack([np.cos(turns), np.sin(turns), heights])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    away = np.linspace(200.0, 300.0, count)[:, None] * ways
    return [np.zeros(3), np.array([35.0, 0.0, 0.0]), *away][:count]


def structures_of(case: Case, count: int) -> list[Structure]:
    """Copies of the tumour's mesh in the frame of the needle."""
    made = []
    for number, place_mm in enumerate(places_mm(count)):
        name = case.tumor.frame if number == 0 else f"structure_{number}"
        mesh = SurfaceMesh(name, case.tumor.vertices_mm, case.tumor.faces)
        pose = Transform("needle", name, np.eye(3), place_mm)
        made.append(
            Structure(pose, ProximityEngine(mesh, case.tool), MARGINS.stop_mm, MARGINS.warn_mm)
        )
    return made


def frames_of(case: Case) -> Iterator[TrackingFrame]:
    """The trajectory as a tracker measures it, with a needle that trembles by 1 um."""
    rng = np.random.default_rng(0)
    for number, pose in enumerate(case.trajectory):
        stamp = Stamp(NS_PER_S + round(number * NS_PER_S / RATE_HZ))
        needle = Transform("tracker", "needle", np.eye(3), rng.normal(scale=1e-3, size=3))
        tumor = Transform("needle", case.tumor.frame, np.eye(3), np.zeros(3))
        cautery = (needle @ tumor @ pose).renamed(source="cautery")
        yield TrackingFrame(
            stamp, tuple(TrackedTransform.valid(p, stamp) for p in (needle, cautery)), ()
        )


def session_step(
    case: Case, structures: list[Structure], *, skip_far: bool
) -> Callable[..., object]:
    first, *others = structures
    setup = SessionSetup(
        tool_from_tip=Transform("cautery", case.tool.frame, np.eye(3), np.zeros(3)),
        frame_from_tumor=first.frame_from_structure,
        proximity=first.proximity,
        margins=MARGINS,
        robot=None,
        structures=tuple(others),
    )
    session = Session(setup, free_motion=True, skip_far=skip_far)
    return lambda frame, pose: session.step(frame)


def fcl_distance(case: Case, count: int) -> Callable[..., object]:
    """Distance of the tool to the nearest of all structures."""
    import fcl

    tree, tool = (
        fcl.DynamicAABBTreeCollisionManager(),
        fcl_object(case.tool.vertices_mm, case.tool.faces),
    )
    for place_mm in places_mm(count):
        structure = fcl_object(case.tumor.vertices_mm, case.tumor.faces)
        structure.setTranslation(place_mm)
        tree.registerObject(structure)
    tree.setup()

    def measure(frame: TrackingFrame, pose: Transform) -> object:
        tool.setTransform(fcl.Transform(pose.rotation, pose.translation_mm))
        found = fcl.DistanceData()
        tree.distance(tool, found, fcl.defaultDistanceCallback)
        return found.result.min_distance

    return measure


def measure(case: Case, counts: list[int]) -> dict[tuple[str, int], dict[str, float]]:
    """Percentiles in ms by form and number of structures; every form takes each pose in turn."""
    peers: dict[tuple[str, int], Callable[..., object]] = {}
    for count in counts:
        peers[LIVE, count] = session_step(case, structures_of(case, count), skip_far=True)
        peers[ALL, count] = session_step(case, structures_of(case, count), skip_far=False)
        peers[FCL, count] = fcl_distance(case, count)
    times_ns: dict[tuple[str, int], list[int]] = {key: [] for key in peers}
    gc.collect()
    gc.freeze()
    frames = list(zip(frames_of(case), case.trajectory, strict=True))
    for frame, pose in with_progress(frames, "poses"):
        for key, peer in peers.items():
            begin = time.thread_time_ns()
            peer(frame, pose)
            times_ns[key].append(time.thread_time_ns() - begin)
    return {key: spread(np.array(values) / 1e6) for key, values in times_ns.items()}


def goals(found: dict[tuple[str, int], dict[str, float]]) -> Iterator[Goal]:
    for count, most in MOST_P99.items():
        two, many = found.get((LIVE, 2)), found.get((LIVE, count))
        ratio = None if two is None or many is None else many["p99_ms"] / two["p99_ms"]
        yield at_most(f"p99 with {count} structures, in that with 2, is", ratio, most, digits=".2f")


def main() -> int:
    parser = BenchParser("structures", __doc__)
    parser.number("--counts", (2, 20, 100), "numbers of structures", low=2, high=100)
    parser.number("--triangles", 20_000, "of each structure, rounded up to 20 * 4^n", low=20)
    parser.number("--poses", 5000, "length of the trajectory", low=100)
    parser.add_argument("--plot", type=Path, metavar="PNG", help="plot time over structures there")
    options = parser.parse_args()
    case = Case.of(options.triangles, TOOL_TRIANGLES, options.poses)
    found = measure(case, sorted(options.counts))
    triangles = f"{len(case.tumor.faces)} triangles each, a tool of {len(case.tool.faces)}"
    steps = [
        {"form": form, "structures": count, **each} for (form, count), each in sorted(found.items())
    ]
    show(columns_table(triangles, steps, {name: name for name in steps[0]}))
    if options.plot is not None:
        lines: dict[str, list[tuple[float, float, float]]] = {}
        for (form, count), each in found.items():
            lines.setdefault(form, []).append((count, each["p50_ms"], each["p99_ms"]))
        write_lines(options.plot, {triangles: lines}, "structures", bold=LIVE)
    return finish(options.json, {"steps": steps}, goals(found))
