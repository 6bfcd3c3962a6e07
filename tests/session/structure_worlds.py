"""Random structures around a tool, as one session and as a session for each structure alone."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from app.case import TrackingFrame
from app.fixture import FixtureDecision, MarginState, Proximity, ProximityEngine, Reason
from app.fixture.control.constraint import MAX_PLANES
from app.fixture.proximity.engine import prepared_tumor
from app.fixture.proximity.values import TURN_RAD, FreeMotion
from app.geometry import (
    NS_PER_MS,
    FloatArray,
    Stamp,
    SurfaceMesh,
    TrackedTransform,
    TrackingStatus,
    Transform,
)
from app.hold import Hold
from app.session import Role, Session, SessionSetup, StepResult, Structure
from tests.doubles import PARAMETERS
from tests.oracles.fixture_oracle import Oracle, random_pose

FRAMES = ("needle", "reference", "clip")
"""Tracked frames of structures."""

FIELD_NODES = 20_000
TIP = Transform("cautery", "cautery_tip", np.eye(3), [0.0, 0.0, 70.0])


def tool_mesh() -> SurfaceMesh:
    """A slender tool, with its tip at the origin and +z forward."""
    box = trimesh.creation.box([3.0, 2.0, 24.0])
    return SurfaceMesh("cautery_tip", box.vertices - [0.0, 0.0, 12.0], box.faces)


TOOL = tool_mesh()


@cache
def first_engine() -> ProximityEngine:
    """The engine whose prepared tool the others share. Not made at import: that may compile."""
    ball = trimesh.creation.icosphere(1, radius=1.0)
    return ProximityEngine(
        SurfaceMesh("any", ball.vertices, ball.faces), TOOL, field_nodes=FIELD_NODES
    )


@dataclass(frozen=True)
class Body:
    """A structure without an engine."""

    mesh: SurfaceMesh
    frame_from_body: Transform
    stop_mm: float
    warn_mm: float
    sigma_mm: float
    role: Role

    def structure(self) -> Structure:
        """The structure with a new engine."""
        engine = first_engine().with_tumor(prepared_tumor(self.mesh, FIELD_NODES))
        return Structure(
            self.frame_from_body, engine, self.stop_mm, self.warn_mm, self.sigma_mm, self.role
        )


def random_mesh(rng: np.random.Generator, name: str) -> SurfaceMesh:
    """A ball, a box or a slab around the origin."""
    match rng.integers(3):
        case 0:
            made = trimesh.creation.icosphere(2, radius=rng.uniform(3.0, 10.0))
        case 1:
            made = trimesh.creation.box(rng.uniform(4.0, 16.0, size=3))
        case _:
            made = trimesh.creation.box([60.0, 60.0, rng.uniform(1.0, 3.0)])
    return SurfaceMesh(name, made.vertices, made.faces)


def random_bodies(rng: np.random.Generator, count: int, spread_mm: float = 20.0) -> list[Body]:
    """``count`` structures on random frames."""
    bodies = []
    for index in range(count):
        stop_mm = rng.uniform(0.0, 3.0)
        name = f"s{index}"
        bodies.append(
            Body(
                random_mesh(rng, name),
                random_pose(rng, spread_mm, str(rng.choice(FRAMES)), name),
                stop_mm,
                stop_mm + rng.uniform(0.5, 6.0),
                float(rng.choice([0.0, 0.4])),
                Role.TARGET if index == 0 else Role(rng.choice(["target", "forbidden"])),
            )
        )
    return bodies


def setup_of(bodies: list[Body]) -> SessionSetup:
    """The setup of a session with ``bodies``, with new engines; the first is the tumour."""
    first, *others = [body.structure() for body in bodies]
    return SessionSetup(
        tool_from_tip=TIP,
        frame_from_tumor=first.frame_from_structure,
        proximity=first.proximity,
        margins=PARAMETERS.replaced(stop_mm=first.stop_mm, warn_mm=first.warn_mm),
        robot=None,
        tumor_sigma_mm=first.sigma_mm,
        structures=tuple(others),
    )


def tracker_poses(
    rng: np.random.Generator, tip_mm: FloatArray, turn: FloatArray
) -> dict[str, Transform]:
    """Frames at rest but for their jitter, and the tool with its tip at ``tip_mm``."""
    poses = {}
    for number, name in enumerate(FRAMES):
        shake, jitter_mm = rng.normal(scale=1e-4, size=3), rng.normal(scale=0.02, size=3)
        rest_mm = np.array([4.0 * number, 1.0, -3.0 * number])
        poses[name] = Transform.from_rotation_vector(
            shake, rest_mm + jitter_mm, target="tracker", source=name
        )
    tip = Transform.from_rotation_vector(turn, tip_mm, target="tracker", source="cautery_tip")
    return poses | {"cautery": tip @ TIP.inverse()}


def faulty_frames(
    rng: np.random.Generator, count: int, jumping: tuple[str, ...]
) -> Iterator[TrackingFrame]:
    """Frames of a tool among the structures; every third has a fault.

    A pose is lost, missing, stale, of the future or repeated, one of ``jumping`` jumps; the clock
    jumps.
    """
    now_ns, tip_mm, turn = 10**10, rng.normal(scale=15.0, size=3), rng.normal(size=3)
    last: dict[str, TrackedTransform] = {}
    for at in range(count):
        now_ns += 20 * NS_PER_MS
        tip_mm, turn = tip_mm * 0.97 + rng.normal(scale=1.5, size=3), turn + 0.03 * rng.normal()
        samples = {
            name: TrackedTransform(pose, Stamp(now_ns), TrackingStatus.OK)
            for name, pose in tracker_poses(rng, tip_mm, turn).items()
        }
        if at > 2 and rng.random() < 0.35:
            name = str(rng.choice(list(samples)))
            sample, pose = samples[name], samples[name].transform
            match rng.choice(
                ["lost", "missing", "stale", "future", "repeat", "jump", "far", "back", "forth"]
            ):
                case "lost":
                    status = rng.choice([TrackingStatus.INVALID, TrackingStatus.OUT_OF_VIEW])
                    samples[name] = TrackedTransform.lost("tracker", name, Stamp(now_ns), status)
                case "missing":
                    del samples[name]
                case "stale":
                    samples[name] = replace(sample, stamp=Stamp(now_ns - 250 * NS_PER_MS))
                case "future":
                    samples[name] = replace(sample, stamp=Stamp(now_ns + 30 * NS_PER_MS))
                case "repeat":
                    samples[name] = replace(last.get(name, sample), stamp=Stamp(now_ns))
                case "jump" if name in jumping:
                    moved = pose.translation_mm + rng.normal(scale=30.0, size=3)
                    moved = Transform("tracker", name, pose.rotation, moved)
                    samples[name] = replace(sample, transform=moved)
                case "far":
                    moved = Transform("tracker", name, pose.rotation, [2e4, 0.0, 0.0])
                    samples[name] = replace(sample, transform=moved)
                case "back":
                    now_ns -= 500 * NS_PER_MS
                    samples = {n: replace(s, stamp=Stamp(now_ns)) for n, s in samples.items()}
                case "forth":
                    now_ns += 300 * NS_PER_MS
        last |= {name: sample for name, sample in samples.items() if sample.transform is not None}
        yield TrackingFrame(Stamp(now_ns), tuple(samples.values()), ())


def assert_same_decision(found: FixtureDecision, alone: FixtureDecision) -> None:
    """All values of two decisions are equal, to the last bit."""
    for name in ("state", "reasons", "margin", "hold", "stamp", "constraint_is_current"):
        assert getattr(found, name) == getattr(alone, name), name
    assert (found.proximity is None) == (alone.proximity is None)
    if found.proximity is not None:
        for name in ("signed_distance_mm", "lower_bound_mm", "contact", "stamp", "free"):
            assert getattr(found.proximity, name) == getattr(alone.proximity, name), name
        np.testing.assert_array_equal(
            found.proximity.witnesses.rows, alone.proximity.witnesses.rows
        )
    assert (found.constraint is None) == (alone.constraint is None)
    if found.constraint is not None:
        assert found.constraint.frame == alone.constraint.frame
        assert found.constraint.hold == alone.constraint.hold
        assert found.constraint.free == alone.constraint.free
        np.testing.assert_array_equal(found.constraint.rows, alone.constraint.rows)


def _invariant(proximity: Proximity) -> tuple[object, ...]:
    """The values that are the same in the frame of each structure."""
    p = proximity
    return p.signed_distance_mm, p.lower_bound_mm, p.contact, p.stamp, p.free


def of_all(step: StepResult) -> list[FixtureDecision]:
    """The decisions on the structures; on the tumour alone that of the session."""
    return [each.decision for each in step.structures] or [step.decision]


def check_jumps(rng: np.random.Generator, structures: int, frames: int) -> int:
    """A jump of any frame makes no structure better than alone; returns the number of jumps."""
    bodies = random_bodies(rng, structures)
    together = Session(setup_of(bodies))
    alone = [Session(setup_of([body])) for body in bodies]
    found = 0
    for frame in faulty_frames(rng, frames, jumping=FRAMES):
        step = together.step(frame)
        for each, session in zip(of_all(step), alone, strict=True):
            assert each.state >= session.step(frame).decision.state
        if Reason.IMPLAUSIBLE in step.decision.reasons:
            found += 1
            assert {each.state for each in of_all(step)} == {MarginState.UNKNOWN}
            assert step.decision.hold and not step.decision.constraint_is_current
    return found


def compare_with_single_sessions(rng: np.random.Generator, structures: int, frames: int) -> None:
    """Each structure is decided as by a session of its own; the whole is the worst of them."""
    bodies = random_bodies(rng, structures)
    together = Session(setup_of(bodies), free_motion=True)
    alone = [Session(setup_of([body]), free_motion=True) for body in bodies]
    holds = [Hold() for _ in bodies]
    # A jump of one frame is a doubt of the tracker, which makes all structures UNKNOWN.
    for frame in faulty_frames(rng, frames, jumping=("cautery",)):
        step = together.step(frame)
        decided = of_all(step)
        for found, hold, session in zip(decided, holds, alone, strict=True):
            # With several structures the hold is put on the decision on all of them.
            held = hold.applied(found, {}) if step.structures else found
            assert_same_decision(held, session.step(frame).decision)
        assert step.decision.state is max(each.state for each in decided)
        if step.decision.proximity is not None:
            each_known = [each.proximity for each in decided if each.proximity is not None]
            assert _invariant(step.decision.proximity) in map(_invariant, each_known)
        assert step.decision.constraint_is_current <= all(
            each.constraint_is_current for each in decided
        )
        if any(each.proximity is None for each in decided):
            assert step.decision.state is MarginState.UNKNOWN
            assert not step.decision.constraint_is_current
            assert step.decision.hold


def crowded_bodies(rng: np.random.Generator, tracked: dict[str, Transform]) -> list[Body]:
    """Structures close around the tool at its pose in ``tracked``; often a narrow corridor."""
    tracker_from_tip = tracked["cautery"] @ TIP
    ways = rng.normal(size=(int(rng.integers(2, 9)), 3))
    if rng.random() < 0.4:
        ways[:2] = [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]  # between two slabs
    bodies = []
    for index, way in enumerate(ways):
        way /= np.linalg.norm(way)
        kind, gap_mm, name = int(rng.integers(3)), rng.uniform(0.6, 4.0), f"s{index}"
        if kind == 0:
            depth_mm = rng.uniform(3.0, 10.0)
            made = trimesh.creation.icosphere(2, radius=depth_mm)
        else:
            depth_mm = rng.uniform(1.0, 3.0)
            made = trimesh.creation.box([20.0 * kind, 20.0 * kind, 2.0 * depth_mm])
        touched_mm = TOOL.vertices_mm[np.argmax(TOOL.vertices_mm @ way)]
        place = Transform("cautery_tip", name, _axes(way), touched_mm + way * (gap_mm + depth_mm))
        frame = str(rng.choice(FRAMES))
        frame_from_body = tracked[frame].inverse() @ tracker_from_tip @ place
        mesh = SurfaceMesh(name, made.vertices, made.faces)
        bodies.append(Body(mesh, frame_from_body, 1.0, 6.0, 0.0, Role.TARGET))
    return bodies


def _axes(way: FloatArray) -> FloatArray:
    """A rotation whose z axis is the unit vector ``way``."""
    side = np.cross(way, np.eye(3)[np.argmin(np.abs(way))])
    side /= np.linalg.norm(side)
    return np.column_stack([side, np.cross(way, side), way])


@dataclass
class Planes:
    """Planes of a decision as numbers, with the pose (4, 4) at which they were made."""

    rows: FloatArray
    from_tip: FloatArray

    def lowest_mm(self, from_tip: FloatArray) -> float:
        """Lowest clearance of the tool at ``from_tip``; of planes that are behind, the approach."""
        on_tip = self._moved(np.linalg.inv(self.from_tip))
        then = on_tip @ from_tip[:3, :3].T + from_tip[:3, 3]
        clearances = np.einsum("ij,ij->i", self.rows[:, 1:4], then) - self.rows[:, 0]
        at_first = np.einsum("ij,ij->i", self.rows[:, 1:4], self.rows[:, 4:7]) - self.rows[:, 0]
        return float((clearances - np.minimum(at_first, 0.0)).min())

    def _moved(self, pose: FloatArray) -> FloatArray:
        return np.asarray(self.rows[:, 4:7] @ pose[:3, :3].T + pose[:3, 3])


def moved_tip(rng: np.random.Generator, pose: FloatArray, free: FreeMotion) -> FloatArray:
    """``pose`` (4, 4) after a random motion of the tool within its free motion."""
    share, used = rng.random(), rng.random()
    way = rng.normal(size=3)
    way *= used * share * min(free.distance_mm, 10.0) / np.linalg.norm(way)
    turn = rng.normal(size=3)
    turn *= used * (1.0 - share) * min(free.turn_rad, TURN_RAD) / np.linalg.norm(turn)
    moved = pose.copy()
    moved[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ pose[:3, :3]
    moved[:3, 3] += way
    return moved


@dataclass
class Judged:
    """Numbers of a comparison of planes, to show that it tested something."""

    motions: int = 0
    left_out: int = 0
    lowest_mm: float = np.inf


def judge_planes(rng: np.random.Generator, motions: int) -> Judged:
    """No motion that the planes of all structures permit breaks those of one, or enters one.

    The planes of each structure are moved by matrices of this file; libigl and FCL judge whether
    the tool enters it.
    """
    turn, place_mm = rng.normal(size=3), rng.normal(scale=10.0, size=3)
    tracked = tracker_poses(rng, place_mm, turn)
    bodies = crowded_bodies(rng, tracked)
    stamp = Stamp(10**9)
    samples = [TrackedTransform(pose, stamp, TrackingStatus.OK) for pose in tracked.values()]
    session = Session(setup_of(bodies), free_motion=True)
    step = session.step(TrackingFrame(stamp, tuple(samples), ()))
    decided, judged = of_all(step), Judged()
    if min(each.proximity.signed_distance_mm for each in decided) < 0.5:
        return judged
    assert step.decision.constraint_is_current
    planes, free = step.decision.constraint.rows, step.decision.constraint.free
    judged.left_out = sum(len(each.constraint) for each in decided) - len(planes)
    assert 0 < len(planes) <= MAX_PLANES and (judged.left_out == 0 or len(planes) == MAX_PLANES)
    tracker_from_tip = tracked["cautery"].matrix @ TIP.matrix
    tracker_from = [
        tracked[body.frame_from_body.target].matrix @ body.frame_from_body.matrix for body in bodies
    ]
    joined = Planes(planes, np.linalg.solve(tracker_from[0], tracker_from_tip))
    single = [
        Planes(each.constraint.rows, np.linalg.solve(pose, tracker_from_tip))
        for each, pose in zip(decided, tracker_from, strict=True)
    ]
    oracles = [Oracle.of(body.mesh, TOOL) for body in bodies]
    for _ in range(motions):
        tumor_from_tip = moved_tip(rng, joined.from_tip, free)
        if joined.lowest_mm(tumor_from_tip) < 0.0:
            continue
        judged.motions += 1
        for body, pose, own, oracle in zip(bodies, tracker_from, single, oracles, strict=True):
            body_from_tip = np.linalg.solve(pose, tracker_from[0] @ tumor_from_tip)
            judged.lowest_mm = min(judged.lowest_mm, own.lowest_mm(body_from_tip))
            assert own.lowest_mm(body_from_tip) > -0.1
            moved = Transform.from_matrix(
                body_from_tip.ravel(), target=body.mesh.frame, source=TOOL.frame
            )
            assert not oracle.overlaps(moved)
    return judged
