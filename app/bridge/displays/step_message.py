"""A step of a session as ``marginguard_msgs/SessionStep``, and back, with the same numbers."""

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from typing import Any

import numpy as np
from marginguard_msgs.msg import SessionStep, StepPoint, StepProximity
from marginguard_msgs.msg import StructureStep as StructureStepMessage

from app.bridge.constraint_message import off_messages
from app.bridge.ros_errors import BridgeError
from app.case import Activation, JointSample, TrackingFrame
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
from app.geometry import (
    ROTATION_TOLERANCE,
    FloatArray,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    Transform,
    check_frame,
)
from app.hold import SeenHold
from app.registration import DriftBound, RegistrationDrift
from app.robot.kinematic_tree import LinkPoses
from app.runtime import SessionContent
from app.session import (
    PathDepth,
    PathPoint,
    Role,
    StepResult,
    StructureStep,
    ToolDistance,
)
from app.session.step_result import known_edges

_NUMBERS = 12
"""Numbers of a transform: the upper three rows of its matrix."""

_NO_POSE = (0.0,) * _NUMBERS
_name = lru_cache(maxsize=1024)(check_frame)  # the same ones in each step


@dataclass(frozen=True, slots=True)
class StepOrigin:
    """Data sent with a step: its guard's run, the content it was taken with, its hold, requests.

    ``request`` and ``recording`` are texts of `app.runtime.SessionWire`.
    """

    instance_id: str
    content_id: str
    seen: SeenHold
    published_ns: int
    request: str = ""
    recording: str = ""
    image_problem: str = ""


def step_message(
    step: StepResult, origin: StepOrigin, others: Sequence[TrackedTransform] = ()
) -> SessionStep:
    """Write ``step``, and ``others``: further poses, by which displays place images."""
    decision, frame = step.decision, step.frame
    samples: list[TrackedTransform] = list(frame.poses)
    index = {id(sample): number for number, sample in enumerate(samples)}
    place = {(each.target, each.source): number for number, each in enumerate(samples)}
    known, usable = [], []
    for edge, sample in step.edges.measured.items():
        number = place.get(edge) if sample is None else index.get(id(sample))
        if number is None:
            number = len(samples)
            missing = TrackedTransform(None, frame.stamp, TrackingStatus.MISSING, *edge)
            samples.append(sample or missing)
        known.append(number)
        usable.append(sample is not None)
    samples += others
    message = SessionStep(
        version=SessionStep.VERSION,
        instance_id=origin.instance_id,
        content_id=origin.content_id,
        index=step.index,
        stamp_ns=frame.stamp.ns,
        published_ns=origin.published_ns,
        hold_seq=origin.seen.seq,
        hold_nonce=origin.seen.nonce,
        state=int(decision.state),
        reasons=[reason.value for reason in decision.reasons],
        hold=decision.hold,
        hold_causes=list(step.hold_causes),
        seq=decision.seq,
        data_stamp_ns=_optional_ns(decision.stamp),
        constraint_hold=False,
        planes_current=decision.constraint_is_current,
        targets=[each.target for each in samples],
        sources=[each.source for each in samples],
        stamps_ns=array("q", [each.stamp.ns for each in samples]),
        statuses=array("B", [each.status for each in samples]),
        transforms=array(
            "d", chain.from_iterable(_pose_numbers(each.transform) for each in samples)
        ),
        new_poses=len(frame.poses),
        known=array("I", known),
        usable=array("B", usable),
        robot_problem=step.robot_problem,
        frames_problems=list(step.frames_problems),
        playback=step.playback,
        single_source=step.single_source,
        cautery="" if frame.activation is None else frame.activation.value,
        request=origin.request,
        recording=origin.recording,
        image_problem=origin.image_problem,
        proximity=_optional_proximity(decision.proximity),
        margin_mm=_margin_numbers(decision.margin),
        structures=[*map(_structure_message, step.structures), *map(_tool_message, step.tools)],
        off=off_messages(step.off),
        tumor_from_tip=_optional_pose(step.tumor_from_tip),
        tumor_from_fixture=_optional_pose(step.virtual_fixture),
    )
    if decision.constraint is not None:
        message.half_spaces = array("d", decision.constraint.rows.tobytes())
        message.free = np.array(decision.constraint.free)
        message.constraint_hold = decision.constraint.hold
    if step.joints is not None:
        message.joints = list(step.joints.names)
        message.positions = array("d", step.joints.positions)
        message.joints_stamp_ns = array("q", [step.joints.stamp.ns])
    if step.links:
        links = LinkPoses.of(step.links)
        message.root_link, message.links = links.root, list(links)
        turns, shifts_mm = links.matrices[:, :3, :3].reshape(-1, 9), links.matrices[:, :3, 3]
        rows = np.concatenate([turns, shifts_mm], axis=1)
        message.link_transforms = array("d", rows.tobytes())
    if step.drift is not None:
        drift, bound = step.drift, step.drift.bound
        message.drift_frame = drift.frame
        moved = drift.translation_mm, drift.rotation_rad
        message.drift = array("d", (*moved, bound.translation_mm, bound.rotation_rad))
    if step.between_frames is not None:
        path = step.between_frames
        message.between = [
            StepPoint(
                stamp_ns=each.stamp.ns,
                tumor_from_tip=np.array(_pose_numbers(each.tumor_from_tip)),
                proximity=_proximity_message(each.proximity),
            )
            for each in (path.deepest, path.end)
        ]
        message.between_lower_bound_mm = path.lower_bound_mm
    return message


def step_of(
    message: SessionStep, content: SessionContent
) -> tuple[StepResult, list[TrackedTransform]]:
    """Read `step_message` of a step that was taken with ``content``: the step, and the others.

    Raises `BridgeError` for another version and for lists that do not belong together.
    """
    if message.version != SessionStep.VERSION:
        raise BridgeError(
            f"step of a session: version {message.version}; expected {SessionStep.VERSION}: the "
            "same MarginGuard on both sides"
        )
    try:
        return _step(message, content)
    except (ValueError, IndexError, TypeError) as error:
        raise BridgeError(f"step of a session: {error}; expected one of a guard") from error


def _step(
    message: SessionStep, content: SessionContent
) -> tuple[StepResult, list[TrackedTransform]]:
    tumor, tip = content.tumor.frame, content.tip_frame
    samples = _samples(message)
    tools = {each.name for each in content.tools}
    stamp = _stamp(message.joints_stamp_ns)
    joints = None
    if stamp is not None:
        joints = JointSample(tuple(message.joints), tuple(message.positions), stamp)
    links = _links(message)
    measured: dict[tuple[str, str], TrackedTransform | None] = {}
    for number, usable in zip(message.known, message.usable, strict=True):
        sample = samples[number]
        measured[sample.target, sample.source] = sample if usable else None
    drift = None
    if len(message.drift):
        moved_mm, turned_rad, *bound = message.drift
        drift = RegistrationDrift(message.drift_frame, moved_mm, turned_rad, DriftBound(*bound))
    step = StepResult(
        index=message.index,
        frame=TrackingFrame(
            Stamp(message.stamp_ns),
            tuple(samples[: message.new_poses]),
            activation=Activation(message.cautery) if message.cautery else None,
        ),
        decision=_decision(message, tumor),
        tumor_from_tip=_placed(tumor, tip, message.tumor_from_tip),
        virtual_fixture=_placed(tumor, "virtual_fixture", message.tumor_from_fixture),
        links=links,
        joints=joints,
        robot_problem=message.robot_problem,
        drift=drift,
        frames_problems=tuple(message.frames_problems),
        playback=message.playback,
        hold_causes=tuple(message.hold_causes),
        single_source=message.single_source,
        edges=known_edges(content.static_edges, content.robot, measured, links, joints),
        between_frames=_path(message, tumor, tip),
        structures=tuple(
            _structure(each, content) for each in message.structures if each.name not in tools
        ),
        tools=tuple(_tool(each) for each in message.structures if each.name in tools),
        off={each.name: each.reason for each in message.off},
    )
    others = len(set(message.known).union(range(message.new_poses)))
    return step, samples[others:]


def _decision(message: SessionStep, tumor: str) -> FixtureDecision:
    constraint = None
    if len(message.half_spaces):
        rows = np.array(message.half_spaces).reshape(-1, 10)
        constraint = Constraint(
            tumor, rows[:, 1:4], rows[:, 0], rows[:, 4:7], rows[:, 7:10],
            hold=message.constraint_hold, free=FreeMotion(*map(float, message.free)),
        )  # fmt: skip
    return _decided(
        message,
        constraint=constraint,
        stamp=_stamp(message.data_stamp_ns),
        seq=message.seq,
        constraint_is_current=message.planes_current,
    )


def _decided(message: SessionStep | StructureStepMessage, **planes: Any) -> FixtureDecision:
    """State, reasons, distance and margin of ``message`` with what only a whole step has."""
    return FixtureDecision(
        state=MarginState(message.state),
        reasons=tuple(map(Reason, message.reasons)),
        proximity=next(map(_proximity, message.proximity), None),
        margin=AppliedMargin(*message.margin_mm) if len(message.margin_mm) else None,
        hold=message.hold,
        **planes,
    )


def _structure_message(step: StructureStep) -> StructureStepMessage:
    decision = step.decision
    return StructureStepMessage(
        name=step.name,
        state=int(decision.state),
        reasons=[reason.value for reason in decision.reasons],
        hold=decision.hold,
        margin_mm=_margin_numbers(decision.margin),
        proximity=_optional_proximity(decision.proximity),
        at_least_mm=[] if step.at_least_mm is None else [step.at_least_mm],
        structure_from_tip=_optional_pose(step.structure_from_tip),
    )


def _structure(message: StructureStepMessage, content: SessionContent) -> StructureStep:
    """The structure without its planes, which are those of the constraint."""
    roles = {each.name: each.role for each in content.structures}
    roles[content.tumor.frame] = Role.TARGET
    if message.name not in roles:
        raise ValueError(f"structure {message.name!r} is not in the description")
    decision = _decided(message, constraint=None, stamp=None, seq=0)
    placed = _placed(message.name, content.tip_frame, message.structure_from_tip)
    far_mm = next(iter(message.at_least_mm), None)
    return StructureStep(message.name, roles[message.name], decision, placed, None, far_mm)


def _tool_message(tool: ToolDistance) -> StructureStepMessage:
    return StructureStepMessage(
        name=tool.name,
        state=int(tool.state),
        reasons=[reason.value for reason in tool.reasons],
        proximity=_optional_proximity(tool.proximity),
        at_least_mm=[] if tool.at_least_mm is None else [tool.at_least_mm],
    )


def _tool(message: StructureStepMessage) -> ToolDistance:
    return ToolDistance(
        message.name,
        MarginState(message.state),
        tuple(map(Reason, message.reasons)),
        next(map(_proximity, message.proximity), None),
        next(iter(message.at_least_mm), None),
    )


def _margin_numbers(margin: AppliedMargin | None) -> "array[float]":
    if margin is None:
        return array("d")
    return array("d", (margin.stop_mm, margin.warn_mm, margin.tre_mm, margin.age_mm))


def _samples(message: SessionStep) -> list[TrackedTransform]:
    statuses = np.frombuffer(bytes(message.statuses), np.uint8)
    if len(message.transforms) != _NUMBERS * len(statuses):
        raise ValueError(f"{len(statuses)} poses have {len(message.transforms)} numbers")
    numbers = _transforms(message.transforms, lost=statuses != TrackingStatus.OK)
    numbers.flags.writeable = False
    rows = zip(
        message.targets, message.sources, message.stamps_ns, message.statuses, numbers, strict=True
    )
    found = []
    for target, source, stamp_ns, status, values in rows:
        stamp = Stamp.of_ns(int(stamp_ns))
        if status != TrackingStatus.OK:
            lost = TrackingStatus(status)
            found.append(TrackedTransform(None, stamp, lost, target, source))
            continue
        rotation, translation_mm = values[:9].reshape(3, 3), values[9:]
        pose = Transform.of_read_only(_name(target), _name(source), rotation, translation_mm)
        found.append(TrackedTransform.valid(pose, stamp))
    return found


def _links(message: SessionStep) -> Mapping[str, Transform]:
    rows = _transforms(message.link_transforms)
    if len(rows) != len(message.links):
        raise ValueError(f"{len(message.links)} links have {len(rows)} transforms")
    if len(rows) == 0:
        return {}
    matrices = np.zeros((len(rows), 4, 4))
    matrices[:, :3, :3], matrices[:, :3, 3] = rows[:, :9].reshape(-1, 3, 3), rows[:, 9:]
    matrices[:, 3, 3] = 1.0
    numbers = {name: number for number, name in enumerate(message.links)}
    return LinkPoses(message.root_link, numbers, matrices)


def _path(message: SessionStep, tumor: str, tip: str) -> PathDepth | None:
    if not message.between:
        return None
    points = []
    for each in message.between:
        pose = _placed(tumor, tip, each.tumor_from_tip)
        assert pose is not None  # 12 numbers by the type of the message
        points.append(PathPoint(Stamp(each.stamp_ns), pose, _proximity(each.proximity)))
    deepest, end = points
    return PathDepth(deepest, message.between_lower_bound_mm, end)


def _proximity_message(proximity: Proximity) -> StepProximity:
    return StepProximity(
        stamp_ns=_optional_ns(proximity.stamp),
        lower_bound_mm=float(proximity.lower_bound_mm),
        contact=bool(proximity.contact),
        free=np.array(proximity.free),
        witnesses=array("d", proximity.witnesses.rows.tobytes()),
    )


def _proximity(message: StepProximity) -> Proximity:
    return Proximity(
        message.lower_bound_mm,
        Witnesses.of_rows(np.array(message.witnesses).reshape(-1, 10)),
        _stamp(message.stamp_ns),
        message.contact,
        FreeMotion(*map(float, message.free)),
    )


def _optional_proximity(proximity: Proximity | None) -> list[StepProximity]:
    return [] if proximity is None else [_proximity_message(proximity)]


def _optional_pose(pose: Transform | None) -> "array[float]":
    return array("d", () if pose is None else _pose_numbers(pose))


def _pose_numbers(pose: Transform | None) -> Sequence[float]:
    if pose is None:
        return _NO_POSE
    return (*pose.rotation.ravel().tolist(), *pose.translation_mm.tolist())


def _transforms(numbers: Any, *, lost: Any = None) -> FloatArray:
    """Rows (n, 12), each rigid; those where ``lost`` (n,) is true may be anything.

    Raises `ValueError` for others.
    """
    rows: FloatArray = np.array(numbers, dtype=np.float64).reshape(-1, _NUMBERS)
    given = rows if lost is None else rows[~np.asarray(lost, dtype=bool)]
    turns = given[:, :9].reshape(-1, 3, 3)
    if not np.isfinite(given).all():
        raise ValueError("a transform has numbers that are not finite")
    error = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max(initial=0.0)
    if error > ROTATION_TOLERANCE or (len(turns) and np.linalg.det(turns).min() < 0.0):
        raise ValueError("a transform is not rigid")
    return rows


def _placed(target: str, source: str, numbers: Sequence[float]) -> Transform | None:
    """The transform of 12 ``numbers``, None without any."""
    rows = _transforms(numbers)
    if len(rows) == 0:
        return None
    (values,) = rows
    return Transform.unchecked(target, source, values[:9].reshape(3, 3), values[9:])


def _optional_ns(stamp: Stamp | None) -> "array[int]":
    return array("q", () if stamp is None else (stamp.ns,))


def _stamp(values: Sequence[int]) -> Stamp | None:
    return Stamp(int(values[0])) if len(values) else None
