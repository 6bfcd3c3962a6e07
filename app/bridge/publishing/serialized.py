"""Moving edges of ``/tf``; transforms, joints and margin of each step as bytes.

Only the numbers of the bytes change from step to step.
"""

import struct
from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from tf2_msgs.msg import TFMessage

from app.bridge import messages
from app.bridge.ros_errors import BridgeError
from app.case.frame_streams import JointSample
from app.fixture import FIXTURE_FRAME, MarginState
from app.geometry import FrameError, Stamp, Transform, chain_to_root
from app.session import StepResult

Block = tuple[tuple[int, int], Sequence[float]]
"""A stamp in s and ns, and the numbers that belong to it."""

_MAX_KNOWN = 64
"""Templates of each kind: a lost sensor makes another set of edges."""


class NumberTemplate:
    """Bytes of the messages that ``make`` returns for blocks of ``counts`` numbers.

    rclpy converts a message field by field, which takes 33 us for the ten transforms of a step; to
    replace the numbers in the bytes of an equal message takes 5 us.

    ``make`` writes each block's stamp into one ``builtin_interfaces/Time`` and its numbers, in
    order, into adjacent fields of 64 bits; all else is the same for all blocks. The places are
    found by the bytes of marks, and a message with other marks proves them. Raises `BridgeError`
    for messages of another form.
    """

    def __init__(self, make: Callable[[Sequence[Block]], Any], counts: Sequence[int]) -> None:
        marks, others = _marks(counts, 1), _marks(counts, 2)
        raw = bytes(serialize_message(make(marks)))
        self._buffer = bytearray(raw)
        order = "<" if raw[1] & 1 else ">"  # of the encapsulation: CDR_LE or CDR_BE
        stamp = struct.Struct(f"{order}iI")
        self._places: list[tuple[struct.Struct, int, struct.Struct, int]] = []
        for at, numbers in marks:
            values = struct.Struct(f"{order}{len(numbers)}d")
            self._places.append(
                (stamp, _place(raw, stamp.pack(*at)), values, _place(raw, values.pack(*numbers)))
            )
        expected = make(others)
        # Not their bytes: the padding between fields is not initialised.
        if deserialize_message(self.serialized(others), type(expected)) != expected:
            raise BridgeError(
                "template of a message: other fields depend on the stamps or numbers; expected "
                "one Time and adjacent numbers of 64 bits per block"
            )
        del self._buffer[_length(self.serialized(others), expected) :]

    def serialized(self, blocks: Sequence[Block]) -> bytes:
        """Return the serialised message with these blocks, as many and as long as ``counts``."""
        buffer = self._buffer
        for (stamp, at, values, begin), (time, numbers) in zip(self._places, blocks, strict=True):
            stamp.pack_into(buffer, at, *time)
            values.pack_into(buffer, begin, *numbers)
        return bytes(buffer)


def _length(raw: bytes, message: Any) -> int:
    """Number of bytes of ``raw`` that hold ``message``.

    rclpy adds up to 8 bytes that are not initialised after an empty sequence of numbers of 64 bits.
    rosbags rejects such a message.
    """
    length = len(raw)
    while length > 4 and _decodes(raw[: length - 1], message):
        length -= 1
    return length


def _decodes(raw: bytes, message: Any) -> bool:
    try:
        return bool(deserialize_message(raw, type(message)) == message)
    except rclpy_implementation.RMWError:
        return False


def _marks(counts: Sequence[int], number: int) -> list[Block]:
    """Blocks whose stamps, 60 years from now, and numbers, above 1e100, occur nowhere else."""
    return [
        (
            (2_100_000_000 + 10 * block + number, 900_000_000 + 10 * block + number),
            [1e100 * (number + 10.0 * block + 0.001 * k) for k in range(count)],
        )
        for block, count in enumerate(counts)
    ]


def _place(raw: bytes, mark: bytes) -> int:
    """Index of the one occurrence of ``mark``; 0 for an empty one."""
    place = raw.find(mark)
    if place < 0 or (mark and raw.find(mark, place + 1) >= 0):
        raise BridgeError(
            f"template of a message: a mark occurs {raw.count(mark)} times; expected once"
        )
    return place


class SerializedTransforms:
    """``tf2_msgs/TFMessage`` of one step after the other, as `app.bridge.tf_topics`."""

    def __init__(self) -> None:
        self._template = lru_cache(_MAX_KNOWN)(_transforms_template)

    def message(self, samples: Sequence[tuple[Transform, Stamp]]) -> bytes:
        """Serialise the message of `tf_message` for ``samples``."""
        edges = tuple([(transform.target, transform.source) for transform, _ in samples])
        return self._template(edges).serialized(
            [
                (messages.time_parts(stamp), messages.transform_numbers(transform))
                for transform, stamp in samples
            ]
        )


class SerializedJoints:
    """``sensor_msgs/JointState`` of one sample after the other."""

    def __init__(self) -> None:
        self._template = lru_cache(_MAX_KNOWN)(_joints_template)

    def message(self, sample: JointSample) -> bytes:
        """Serialise the message of `joint_state_message` for ``sample``."""
        block = messages.time_parts(sample.stamp), sample.positions
        return self._template(sample.names).serialized([block])


class SerializedMargin:
    """``std_msgs/Float64`` of a distance and ``std_msgs/ColorRGBA`` of a state."""

    def __init__(self) -> None:
        raw = bytes(serialize_message(Float64()))
        self._header = raw[:-8]
        self._number = struct.Struct("<d" if raw[1] & 1 else ">d")  # CDR_LE or CDR_BE
        self._colors = {
            state: bytes(serialize_message(messages.color_message(state.color)))
            for state in MarginState
        }

    def distance(self, distance_mm: float) -> bytes:
        """Serialise the message of a distance."""
        return self._header + self._number.pack(distance_mm)

    def color(self, state: MarginState) -> bytes:
        """The serialised colour of ``state``."""
        return self._colors[state]


def _transforms_template(edges: tuple[tuple[str, str], ...]) -> NumberTemplate:
    def made(blocks: Sequence[Block]) -> TFMessage:
        pairs = zip(edges, blocks, strict=True)
        return TFMessage(transforms=[messages.transform_of(*edge, *block) for edge, block in pairs])

    return NumberTemplate(made, [messages.TRANSFORM_NUMBERS] * len(edges))


def _joints_template(names: tuple[str, ...]) -> NumberTemplate:
    def made(blocks: Sequence[Block]) -> JointState:
        (((seconds, nanoseconds), positions),) = blocks
        message = JointState(name=list(names), position=array("d", positions))
        message.header.stamp.sec, message.header.stamp.nanosec = seconds, nanoseconds
        return message

    return NumberTemplate(made, [len(names)])


@dataclass(frozen=True, slots=True)
class PublishPolicy:
    """Shared topics that this node publishes: those that other nodes may publish, too.

    A replay is alone on the graph and publishes all of them. ``clock``: the session's time is the
    time of the graph; ``measured``: the tracker's edges; ``robot``: its description, joints and
    links. ``fixture_frame`` is the name of the frame of the governing plane on tf.
    """

    clock: bool = True
    measured: bool = True
    robot: bool = True
    fixture_frame: str = FIXTURE_FRAME


PUBLISH_ALL = PublishPolicy()


def moving_edges(
    step: StepResult, policy: PublishPolicy = PUBLISH_ALL
) -> Iterator[tuple[Transform, Stamp]]:
    """Yield every transform of ``step`` with the time at which it was measured.

    Measured edges are published as measured. Lost ones are left out: tf cannot represent a lost
    pose, so its absence and ``/diagnostics`` report it. The links of the robot are all children of
    its root, so that no joint is needed to place them. The fixture has the stamp of the oldest
    sample that went in; while the margin is UNKNOWN the last plane still holds, but nothing newer
    is known.
    """
    for sample in step.frame.poses if policy.measured else ():
        if sample.transform is not None:
            yield sample.transform, sample.stamp
    if step.joints is not None and policy.robot:
        for link, root_from_link in step.links.items():
            if link != root_from_link.target:
                yield root_from_link, step.joints.stamp
    decision = step.decision
    if (
        decision.state is not MarginState.UNKNOWN
        and decision.stamp is not None
        and step.virtual_fixture is not None
    ):
        fixture = step.virtual_fixture
        if fixture.source != policy.fixture_frame:
            fixture = fixture.renamed(source=policy.fixture_frame)
        yield fixture, decision.stamp


class FrameTree:
    """Selects the edges of each step that tf can hold, and each sample once.

    A tracker may report more edges than a tree holds (``ToolToTracker`` beside
    ``ToolToReference``), but in tf a frame has one parent and there are no loops: the edge that
    came first stays, the calibrations of ``static_edges`` before all. tf2 also complains about a
    transform that is published again with its stamp, as for a joint sample when the tracker is
    faster than the robot. When the player seeks back, all samples are new again. Raises
    `FrameError` for static edges that form no tree by themselves.
    """

    def __init__(
        self, static_edges: Iterable[Transform] = (), policy: PublishPolicy = PUBLISH_ALL
    ) -> None:
        self._policy = policy
        self._parents: dict[str, str] = {}
        self._static: frozenset[str] = frozenset()
        self._newest_ns: dict[str, int] = {}
        self._now_ns: int | None = None
        self.left_out: dict[tuple[str, str], str] = {}
        """Edges (parent, child) that do not fit into the tree, with the reason."""
        for edge in static_edges:
            if not self._fits(edge):
                raise FrameError(
                    f"static transforms: {self.left_out[edge.target, edge.source]}; expected a tree"
                )
        self._static = frozenset(self._parents)

    def new_edges(self, step: StepResult) -> list[tuple[Transform, Stamp]]:
        """Moving edges of ``step`` that are newer than the last ones of the same child frame."""
        if self._now_ns is not None and step.frame.stamp.ns < self._now_ns:
            self._newest_ns.clear()
        self._now_ns = step.frame.stamp.ns
        found = []
        for transform, stamp in moving_edges(step, self._policy):
            newest_ns = self._newest_ns.get(transform.source)
            if self._fits(transform) and (newest_ns is None or stamp.ns > newest_ns):
                self._newest_ns[transform.source] = stamp.ns
                found.append((transform, stamp))
        return found

    def _fits(self, edge: Transform) -> bool:
        parent, child = edge.target, edge.source
        known = self._parents.get(child)
        if known == parent and child not in self._static:
            return True
        if known is not None:
            self.left_out[parent, child] = f"{child!r} already has the parent {known!r}"
            return False
        if child in chain_to_root(parent, self._parents.get):
            self.left_out[parent, child] = (
                f"{parent!r} is below {child!r}; the edge would close a loop"
            )
            return False
        self._parents[child] = parent
        return True
