"""Fixtures of ROS: other processes, a tracker's frames, contents and steps to publish."""

import json
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import dropwhile, takewhile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from app.case import open_case
from app.case.frame_streams import JointSample, TrackingFrame
from app.fixture import (
    AppliedMargin,
    Constraint,
    FixtureDecision,
    FreeMotion,
    MarginState,
    Proximity,
    Reason,
    Witnesses,
)
from app.geometry import NS_PER_MS, NS_PER_S, Stamp, TrackedTransform, TrackingStatus, Transform
from app.runtime import SessionContent
from app.session import StepResult
from tests import shipped_case
from tests.bridge.processes import DEADLINE_S as DEADLINE_S
from tests.bridge.processes import Child, Receiver
from tests.ros_domain import domain_id as domain_id
from tests.session_content import ONE_LINK_URDF, one_link_content

HERE = Path(__file__).resolve().parent
CALLER, RECEIVER = HERE / "caller.py", HERE / "receiver.py"
SENDER = HERE / "live" / "sender.py"
LIVE = ("-m", "app.cli", "live", "--constraint-hz", "100", "--config")
CONSTRAINT = "/marginguard/constraint:marginguard_msgs/msg/FixtureConstraint:1000000"
TRACKED = {"tracked_transforms": {}, "clock": "host"}
TF = {"tf": {}, "clock": "host"}

Start = Callable[..., Child]
StartReceiver = Callable[..., Receiver]


@pytest.fixture
def ros(domain_id: int) -> Iterator[Any]:
    """The node ``marginguard``."""
    from app.bridge.node import RosNode  # loads ROS

    with RosNode("marginguard", domain_id=domain_id) as node:
        yield node


@pytest.fixture
def other(domain_id: int) -> Iterator[Any]:
    """A second node of this process."""
    from app.bridge.node import RosNode

    with RosNode("other", domain_id=domain_id) as node:
        yield node


@contextmanager
def started_in(folder: Path) -> Iterator[Callable[..., Any]]:
    """Start processes of a kind, with their logs in ``folder``; kill them at the end."""
    started: list[Child] = []

    def start(kind: type[Child], *arguments: object, **options: Any) -> Child:
        log = folder / f"{kind.__name__.lower()}_{len(started)}.log"
        started.append(kind(arguments, log, **options))
        return started[-1]

    yield start
    for child in started:
        child.close()


@pytest.fixture
def start(domain_id: int, tmp_path: Path) -> Iterator[Start]:
    """``start("-m", "app.cli", ...)``; killed after the test."""
    with started_in(tmp_path) as begin:
        yield lambda *arguments: begin(Child, *arguments)


@pytest.fixture
def start_live(start: Start) -> Start:
    """``start_live(config, *options)`` starts a session and waits for its first line."""

    return partial(begin_live, start)


def begin_live(start: Start, config: object, *options: object) -> Child:
    """Start a session and wait for its first line, which comes before anything is tracked."""
    live = start(*LIVE, config, *options)
    live.line(lambda line: line.startswith("UNKNOWN"))
    return live


@pytest.fixture
def start_sender(start: Start, frames_file: Path) -> Start:
    """``start_sender("tf", "again")`` starts a tracker that sends the frames."""
    return partial(start, SENDER, frames_file)


@pytest.fixture
def start_receiver(domain_id: int, tmp_path: Path) -> Iterator[StartReceiver]:
    """``start_receiver("/tf:tf2_msgs/msg/TFMessage:10", ...)``; killed after the test."""

    def receive(
        *arguments: str, script: Path = RECEIVER, wait: bool = True, **options: Any
    ) -> Receiver:
        receiver: Receiver = begin(Receiver, script, *arguments, **options)
        if wait:
            receiver.wait_until_ready()
        return receiver

    with started_in(tmp_path) as begin:
        yield receive


CYCLONE = HERE / "cyclone_listener.py"
CYCLONE_ON_THIS_MACHINE = {
    "CYCLONEDDS_URI": (
        "<CycloneDDS><Domain><General>"
        "<Interfaces><NetworkInterface name='lo' multicast='false'/></Interfaces>"
        "<AllowMulticast>false</AllowMulticast>"
        "</General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
        "<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>"
        "<Peers><Peer address='localhost'/></Peers>"
        "</Discovery></Domain></CycloneDDS>"
    )
}


@pytest.fixture
def start_cyclone(start_receiver: StartReceiver) -> StartReceiver:
    """``start_cyclone("virtual_fixture", "10")`` starts a ``/tf`` listener without ROS."""
    return partial(start_receiver, script=CYCLONE, environment=CYCLONE_ON_THIS_MACHINE)


@pytest.fixture(scope="session")
def breach(project_root: Path) -> list[TrackingFrame]:
    """1.6 s of the shipped case around its first breach; every pose is tracked."""
    frames = open_case(project_root / "data" / "recorded_case").recorded_frames()
    first_ns = next(frames).stamp.ns
    start_ns = first_ns + round((shipped_case.DEEP["start_s"] - 0.5) * NS_PER_S)
    end_ns = start_ns + round(1.6 * NS_PER_S)
    from_start = dropwhile(lambda frame: frame.stamp.ns < start_ns, frames)
    found = list(takewhile(lambda frame: frame.stamp.ns < end_ns, from_start))
    assert all(sample.transform is not None for f in found for sample in f.poses)
    return found


@pytest.fixture(scope="session")
def frames_file(breach: list[TrackingFrame], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The frames as a file for ``sender.py``; joint states have the stamps of another clock."""
    path = tmp_path_factory.mktemp("frames") / "frames.json"
    path.write_text(json.dumps([_plain(frame) for frame in breach]))
    return path


@pytest.fixture(scope="session")
def live_yaml(project_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """``live_yaml(source)`` writes the example's configuration with another source."""

    def write(source: dict[str, Any], stale_after_ms: float = 400.0) -> Path:
        values = yaml.safe_load((project_root / "data/live_example/live.yaml").read_text())
        values["source"] = source
        values["margins"]["stale_after_ms"] = stale_after_ms
        path = tmp_path_factory.mktemp("live") / "live.yaml"
        path.write_text(yaml.safe_dump(values))
        return path

    return write


@pytest.fixture
def structures_yaml(project_root: Path, tmp_path: Path) -> Path:
    """The example's configuration with the three structures of the shipped case."""
    live, case = (
        yaml.safe_load((project_root / "data" / name).read_text())
        for name in ("live_example/live.yaml", "structures_case/case.yaml")
    )
    for structure in case["structures"][1:]:
        mesh = structure["mesh"]
        mesh["path"] = f"package://marginguard/structures_case/{mesh['path']}"
    del live["tumor"], live["margins"]["stop_mm"], live["margins"]["warn_mm"]
    tool, robot = live.pop("tool"), live.pop("robot")
    robot |= {"name": "robot_base", "holds": "cautery", "registration": live.pop("registration")}
    live |= {"schema": 2, "structures": case["structures"], "robots": [robot]}
    path = tmp_path / "live.yaml"
    path.write_text(yaml.safe_dump(live | {"tools": [{"name": "cautery", **tool}]}))
    return path


def _plain(frame: TrackingFrame) -> dict[str, Any]:
    return {
        "ns": frame.stamp.ns,
        "edges": [_edge(sample) for sample in frame.poses],
        "joints": [
            {
                "names": list(sample.names),
                "positions": list(sample.positions),
                "ns": sample.stamp.ns - round(shipped_case.CLOCK_OFFSET_MS * NS_PER_MS),
            }
            for sample in frame.joints
        ],
    }


def _edge(sample: TrackedTransform) -> dict[str, Any]:
    pose = sample.transform
    return {
        "parent": sample.target,
        "child": sample.source,
        "status": int(sample.status),
        "translation_m": [math.nan] * 3
        if pose is None
        else (pose.translation_mm / 1000.0).tolist(),
        "quaternion": [math.nan] * 4 if pose is None else pose.quaternion_xyzw.tolist(),
    }


START_NS = 1_700_000_000_000_000_001
FRAME_NS = 20_000_000


@pytest.fixture
def content(tmp_path: Path) -> SessionContent:
    """Content with a tetrahedron as tumour, a smaller one as tool, and a registered robot."""
    urdf = tmp_path / "one_link.urdf"
    urdf.write_text(ONE_LINK_URDF)
    return one_link_content(urdf)


MakeStep = Callable[..., StepResult]


@pytest.fixture
def make_step() -> MakeStep:
    """``make_step(3)`` makes the fourth step of a replay at 50 Hz, with all frames tracked."""
    return _step


def _step(index: int, *, lost: bool = False, state: MarginState | None = None) -> StepResult:
    """Step with the tool 7.5 mm from the tumour, moving along x by 1 mm per step.

    The needle's sample is 3 ms older than the frame and governs the decision's stamp.
    """
    now = Stamp(START_NS + index * FRAME_NS)
    oldest = Stamp(now.ns - 3_000_000)
    cautery = Transform("tracker", "cautery", np.eye(3), [100.0 + index, -20.0, 30.0])
    poses = (
        TrackedTransform.lost("tracker", "cautery", now, TrackingStatus.INVALID)
        if lost
        else TrackedTransform(cautery, now, TrackingStatus.OK),
        TrackedTransform(
            Transform("reference", "needle", np.eye(3), [0.0, 50.0, 0.0]), oldest, TrackingStatus.OK
        ),
    )
    joints = JointSample(("waist", "slide"), np.array([0.5, 0.01]), Stamp(now.ns - 5_000_000))
    state = state or (MarginState.UNKNOWN if lost else MarginState.NEGATIVE)
    constraint = Constraint(
        frame="tumor",
        normals=np.array([[0.0, 0.0, 1.0]]),
        offsets_mm=np.array([12.5]),
        points_on_tool_mm=np.array([[1.0, 2.0, 17.5]]),
        tumor_velocities_mm_s=np.array([[0.0, 4.0, 0.0]]),
        hold=lost,
        free=FreeMotion(1000.0, 10.0),
    )
    decision = FixtureDecision(
        state=state,
        reasons=(Reason.INVALID, Reason.LATCHED) if lost else (Reason.CLEAR,),
        proximity=None
        if lost
        else Proximity(
            lower_bound_mm=7.25,
            witnesses=Witnesses.single(
                7.5,
                on_tool_mm=np.array([1.0, 2.0, 17.5]),
                on_tumor_mm=np.array([1.0, 2.0, 10.0]),
                normal=np.array([0.0, 0.0, 1.0]),
            ),
            stamp=oldest,
        ),
        margin=None if lost else AppliedMargin(1.0, 5.0, tre_mm=0.5, age_mm=0.25),
        constraint=constraint,
        hold=lost,
        stamp=oldest,
        seq=index,
        constraint_is_current=not lost,
    )
    return StepResult(
        index=index,
        frame=TrackingFrame(now, poses, (joints,)),
        decision=decision,
        tumor_from_tip=None if lost else Transform.identity("tumor", "cautery_tip"),
        virtual_fixture=constraint.fixture_frame(None),
        links={
            "base_link": Transform.identity("base_link", "base_link"),
            "stylus": Transform("base_link", "stylus", np.eye(3), [0.0, 0.0, 133.35]),
        },
        joints=joints,
    )
