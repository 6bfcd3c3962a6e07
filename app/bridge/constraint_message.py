"""Constraints as messages: built from decisions, read as plain values in mm, received."""

import math
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Literal, Self

import numpy as np
from geometry_msgs.msg import TransformStamped
from marginguard_msgs.msg import FixtureConstraint, HalfSpace, StructureOff, StructureState

from app.bridge import messages
from app.bridge.convert.generic_topics import create_endpoint, read_message
from app.bridge.messages import MM_PER_M, ns_of
from app.bridge.node import RosNode
from app.bridge.ros_errors import BridgeError
from app.bridge.sender_names import SingleSender
from app.bridge.topics import NEWEST, Topic
from app.fixture import (
    MAX_TURN_RAD_S,
    Constraint,
    FixtureDecision,
    FreeMotion,
    MarginState,
    PlainConstraint,
)
from app.geometry import FloatArray, InputError, Stamp
from app.runtime import LatestValue, ReceivedConstraint, ReceivedStructure, SessionContent
from app.session import StructureStep

DEFAULT_TOPIC = "/marginguard/constraint"


class ConstraintBuilder:
    """Converts decisions to messages and keeps the stamp of the last current planes.

    A decision whose planes do not belong to the current pose contains the last planes that did.
    The message then keeps their stamp and ``valid_until``, so that planes never appear newer than
    they are. Without planes both are zero, which is long past, and ``hold`` is set.
    """

    def __init__(self, content: SessionContent) -> None:
        self._planes_from: Stamp | None = None
        self.use(content)

    def use(self, content: SessionContent) -> None:
        """Use margins, tumour and registration of ``content`` from the next message on."""
        self._frame = content.tumor.frame
        self._stale_after_ns = content.margins.stale_after_ns
        self._k_tre = content.margins.k_tre
        self._max_tool_speed = _metres(content.margins.v_max_mm_s)
        self._model_id = content.model_id
        self._registration_id = content.registration_id
        self._setup_id = content.setup_id
        self._tumor = messages.transform_message(content.frame_from_tumor, Stamp(0))
        self._base = TransformStamped()
        if content.registration is not None:
            self._base = messages.transform_message(content.registration.transform, Stamp(0))

    def message(
        self,
        decision: FixtureDecision,
        *,
        hold_causes: Sequence[str] = (),
        simulated: bool = True,
        single_source: bool = True,
        structures: Sequence[StructureStep] = (),
        half_spaces_of: Sequence[int] = (),
        off: Mapping[str, str] = MappingProxyType({}),
    ) -> FixtureConstraint:
        """Convert ``decision``; the publisher sets ``seq``.

        ``structures``, ``half_spaces_of`` and ``off`` are those of `StepResult`.
        ``simulated``: the poses are recorded or simulated. ``single_source``: nothing checks them.
        """
        known = decision.state is not MarginState.UNKNOWN
        if decision.constraint is None:
            self._planes_from = None
        elif decision.constraint_is_current:
            self._planes_from = decision.stamp
        message = FixtureConstraint(
            state=int(decision.state),
            reasons=[str(reason) for reason in decision.reasons],
            hold=decision.hold,
            hold_causes=list(hold_causes),
            simulated=simulated,
            planes_current=decision.constraint_is_current,
            single_source=single_source,
            lower_bound=math.nan,
            stop_distance=math.nan,
            warn_distance=math.nan,
            sigma_tre=math.nan,
            max_tool_speed=self._max_tool_speed,
            max_tool_turn=MAX_TURN_RAD_S,
            model_id=self._model_id,
            registration_id=self._registration_id,
            setup_id=self._setup_id,
            tumor=self._tumor,
            base=self._base,
            structures=[
                StructureState(
                    name=each.name,
                    state=int(each.decision.state),
                    signed_distance=_known_distance(each.decision),
                    lower_bound=_known_bound(each),
                )
                for each in structures
            ],
            off=off_messages(off),
        )
        message.header.frame_id = self._frame
        if self._planes_from is not None:
            messages.set_time(message.header.stamp, self._planes_from)
            expires = self._planes_from.shifted(self._stale_after_ns, self._planes_from.clock)
            messages.set_time(message.valid_until, expires)
        if decision.constraint is not None:
            message.half_spaces = [_half_space(*row) for row in decision.constraint.rows.tolist()]
            message.half_space_structures = list(half_spaces_of) if structures else []
            message.free_distance = _metres(decision.constraint.free.distance_mm)
            message.free_turn = decision.constraint.free.turn_rad
        message.signed_distance = _known_distance(decision)
        if known and decision.proximity is not None:
            message.lower_bound = _metres(decision.proximity.lower_bound_mm)
        if decision.margin is not None:
            message.stop_distance = _metres(decision.margin.total_mm)
            message.warn_distance = _metres(decision.margin.warn_total_mm)
            if self._k_tre > 0.0:
                message.sigma_tre = _metres(decision.margin.tre_mm / self._k_tre)
        return message


def _known_bound(structure: StructureStep) -> float:
    """A lower bound of the signed distance in m, NaN if it is not known."""
    proximity, far_mm = structure.decision.proximity, structure.at_least_mm
    if far_mm is not None:
        return _metres(far_mm)
    if structure.decision.state is MarginState.UNKNOWN or proximity is None:
        return math.nan
    return _metres(proximity.lower_bound_mm)


def _known_distance(decision: FixtureDecision) -> float:
    """The signed distance in m, NaN if it is not known."""
    if decision.state is MarginState.UNKNOWN or decision.proximity is None:
        return math.nan
    return _metres(decision.proximity.signed_distance_mm)


def _half_space(
    offset_mm: float,
    nx: float, ny: float, nz: float,
    px: float, py: float, pz: float,
    vx: float, vy: float, vz: float,
) -> HalfSpace:  # fmt: skip
    """One row of `Constraint.rows`: a unit normal, offset and point in m, velocity in m/s.

    Fills in a new message, quicker than to construct its parts.
    """
    message = HalfSpace(offset=_metres(offset_mm))
    normal, point, velocity = message.normal, message.point_on_tool, message.tumor_velocity
    normal.x, normal.y, normal.z = nx, ny, nz
    point.x, point.y, point.z = _metres(px), _metres(py), _metres(pz)
    velocity.x, velocity.y, velocity.z = _metres(vx), _metres(vy), _metres(vz)
    return message


def _metres(value_mm: float) -> float:
    return float(value_mm) / MM_PER_M


def split_at_seq(raw: bytes) -> tuple[bytes, int, bytes]:
    """The ``seq`` of a serialised constraint, with the bytes before and after it.

    CDR: 4 bytes of encapsulation, stamp (2 x 4 bytes), string length (4), string with its zero, seq
    aligned to 8. Bytes that are no constraint give any parts.
    """
    order: Literal["little", "big"] = "little" if raw[1] & 1 else "big"
    text_bytes = int.from_bytes(raw[12:16], order)
    begin = 4 + -(-(12 + text_bytes) // 8) * 8
    return raw[:begin], int.from_bytes(raw[begin : begin + 8], order), raw[begin + 8 :]


def plain_constraint(message: FixtureConstraint) -> PlainConstraint:
    """The values of ``message`` that `app.fixture.FixtureRule` needs; nothing is checked."""
    planes = message.half_spaces
    return PlainConstraint(
        instance_id=message.instance_id,
        seq=message.seq,
        frame=message.header.frame_id,
        stamp_ns=ns_of(message.header.stamp),
        valid_until_ns=ns_of(message.valid_until),
        state=message.state,
        hold=message.hold,
        simulated=message.simulated,
        planes_current=message.planes_current,
        normals=_vectors([plane.normal for plane in planes]),
        offsets_mm=MM_PER_M * np.array([plane.offset for plane in planes]),
        points_on_tool_mm=MM_PER_M * _vectors([plane.point_on_tool for plane in planes]),
        tumor_velocities_mm_s=MM_PER_M * _vectors([plane.tumor_velocity for plane in planes]),
        free_distance_mm=MM_PER_M * message.free_distance,
        free_turn_rad=message.free_turn,
        max_tool_speed_mm_s=MM_PER_M * message.max_tool_speed,
        max_tool_turn_rad_s=message.max_tool_turn,
        setup_id=message.setup_id,
    )


def _vectors(values: list[object]) -> FloatArray:
    """``Vector3`` or ``Point`` messages as an array (k, 3)."""
    return np.array([(each.x, each.y, each.z) for each in values]).reshape(-1, 3)  # type: ignore[attr-defined]


class ConstraintReader:
    """``with ConstraintReader() as reader: reader.read()``: constraints as they arrive.

    Only the newest constraint is kept: a slow reader misses older ones. ``for received in reader``
    yields constraints until none arrives for ``timeout_s``, which raises. While two publishers send
    constraints, `read` raises: nothing tells which of them is the session. Call
    `app.bridge.prepare_environment` before.
    """

    def __init__(self, topic: str = DEFAULT_TOPIC, *, timeout_s: float = 5.0) -> None:
        """Raises `BridgeError` for a ``topic`` or ``timeout_s`` that cannot be used."""
        if not 0.0 < timeout_s < math.inf:
            raise BridgeError(f"timeout_s: is {timeout_s!r}; expected seconds > 0")
        self._topic = Topic(topic, FixtureConstraint, NEWEST)
        self._timeout_s = timeout_s
        self._newest: LatestValue[bytes] = LatestValue()
        self._ros = RosNode("constraint_reader")
        try:
            # A message wakes `read` in a conflict too, which then raises or finds its end.
            self._sender = create_endpoint(
                lambda: SingleSender(self._ros, self._topic, self._newest.put, in_conflict=True),
                topic,
            )
        except BaseException:
            self._ros.close()
            raise

    def read(self, timeout_s: float | None = None) -> ReceivedConstraint:
        """The newest constraint that has not been read yet; waits for it.

        Raises `BridgeError` if none arrives in ``timeout_s``, for an invalid message, and while two
        publishers send.
        """
        limit_s = self._timeout_s if timeout_s is None else timeout_s
        raw = self._newest.take(limit_s)
        if problem := self._sender.problem():
            raise BridgeError(problem)
        if raw is None:
            raise BridgeError(f"{self._topic.name}: no constraint in {limit_s:g} s{self._cause()}")
        return _received(read_message(raw, self._topic), self._topic.name)

    def close(self) -> None:
        """Leave the ROS graph."""
        self._ros.close()

    def __iter__(self) -> Iterator[ReceivedConstraint]:
        while True:
            yield self.read()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _cause(self) -> str:
        """The probable cause for which no message has arrived, as the end of an error message."""
        policy = self._ros.incompatible.get(self._topic.name)
        if policy is not None:
            return f"; its publisher has an incompatible {policy}"
        if self._ros.node.count_publishers(self._topic.name) == 0:
            return "; it has no publisher in this ROS domain; expected a running session"
        return "; its publisher is silent; expected a running session"


def _received(message: FixtureConstraint, topic: str) -> ReceivedConstraint:
    try:
        state = MarginState(message.state)
    except ValueError as error:
        raise BridgeError(f"{topic}: state is {message.state}; expected 0 to 3") from error
    if not message.half_spaces and not message.hold:
        raise BridgeError(f"{topic}: no half-spaces and no hold; expected hold without a plane")
    plain = plain_constraint(message)
    return ReceivedConstraint(
        seq=message.seq,
        stamp_ns=plain.stamp_ns,
        valid_until_ns=plain.valid_until_ns,
        state=state,
        reasons=tuple(message.reasons),
        hold=message.hold,
        constraint=_constraint(plain, topic),
        signed_distance_mm=_mm(message.signed_distance),
        lower_bound_mm=_mm(message.lower_bound),
        stop_total_mm=_mm(message.stop_distance),
        warn_total_mm=_mm(message.warn_distance),
        sigma_tre_mm=_mm(message.sigma_tre),
        model_id=message.model_id,
        registration_id=message.registration_id,
        setup_id=message.setup_id,
        max_tool_speed_mm_s=plain.max_tool_speed_mm_s,
        max_tool_turn_rad_s=plain.max_tool_turn_rad_s,
        instance_id=message.instance_id,
        rearm_nonce=message.rearm_nonce,
        hold_causes=tuple(message.hold_causes),
        simulated=message.simulated,
        planes_current=message.planes_current,
        single_source=message.single_source,
        structures=_structures(message, topic),
        half_spaces_of=tuple(message.half_space_structures),
        off={each.name: each.reason for each in message.off},
    )


def off_messages(off: Mapping[str, str]) -> list[StructureOff]:
    """The structures that are switched off, by name, with the reason of each."""
    return [StructureOff(name=name, reason=reason) for name, reason in off.items()]


def _structures(message: FixtureConstraint, topic: str) -> tuple[ReceivedStructure, ...]:
    try:
        return tuple(
            ReceivedStructure(
                each.name,
                MarginState(each.state),
                _mm(each.signed_distance),
                _mm(each.lower_bound),
            )
            for each in message.structures
        )
    except ValueError as error:
        raise BridgeError(f"{topic}: structures: {error}; expected states of 0 to 3") from error


def _constraint(plain: PlainConstraint, topic: str) -> Constraint | None:
    if len(plain.normals) == 0:
        return None
    try:
        return Constraint(
            frame=plain.frame,
            normals=plain.normals,
            offsets_mm=plain.offsets_mm,
            points_on_tool_mm=plain.points_on_tool_mm,
            tumor_velocities_mm_s=plain.tumor_velocities_mm_s,
            hold=plain.hold,
            free=FreeMotion(plain.free_distance_mm, plain.free_turn_rad),
        )
    except InputError as error:
        raise BridgeError(f"{topic}: invalid half-spaces: {error}") from error


def _mm(value_m: float) -> float | None:
    return value_m * MM_PER_M if math.isfinite(value_m) else None
