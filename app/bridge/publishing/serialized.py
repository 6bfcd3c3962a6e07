"""Transforms, joints and margin of each step as bytes, of which only the numbers change."""

import struct
from array import array
from collections.abc import Sequence

from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from tf2_msgs.msg import TFMessage

from app.bridge import messages
from app.bridge.number_template import Block, NumberTemplate
from app.case.tracking_frames import JointSample
from app.fixture import MarginState
from app.geometry import Stamp, Transform

_MAX_KNOWN = 64
"""Templates of each kind: a lost sensor makes another set of edges."""


class SerializedTransforms:
    """``tf2_msgs/TFMessage`` of one step after the other, as `app.bridge.tf.broadcaster`."""

    def __init__(self) -> None:
        self._known: dict[tuple[tuple[str, str], ...], NumberTemplate] = {}

    def message(self, samples: Sequence[tuple[Transform, Stamp]]) -> bytes:
        """Serialise the message of `tf_message` for ``samples``."""
        edges = tuple([(transform.target, transform.source) for transform, _ in samples])
        template = self._known.get(edges)
        if template is None:
            if len(self._known) >= _MAX_KNOWN:
                self._known.clear()
            template = self._known[edges] = NumberTemplate(
                lambda blocks: _transforms(edges, blocks), [messages.TRANSFORM_NUMBERS] * len(edges)
            )
        return template.serialized(
            [
                (messages.time_parts(stamp), messages.transform_numbers(transform))
                for transform, stamp in samples
            ]
        )


class SerializedJoints:
    """``sensor_msgs/JointState`` of one sample after the other."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, ...], NumberTemplate] = {}

    def message(self, sample: JointSample) -> bytes:
        """Serialise the message of `joint_state_message` for ``sample``."""
        names = sample.names
        template = self._known.get(names)
        if template is None:
            if len(self._known) >= _MAX_KNOWN:
                self._known.clear()
            template = self._known[names] = NumberTemplate(
                lambda blocks: _joints(names, blocks), [len(names)]
            )
        return template.serialized([(messages.time_parts(sample.stamp), sample.positions)])


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


def _transforms(edges: Sequence[tuple[str, str]], blocks: Sequence[Block]) -> TFMessage:
    return TFMessage(
        transforms=[
            messages.transform_of(*edge, *block) for edge, block in zip(edges, blocks, strict=True)
        ]
    )


def _joints(names: Sequence[str], blocks: Sequence[Block]) -> JointState:
    (((seconds, nanoseconds), positions),) = blocks
    message = JointState(name=list(names), position=array("d", positions))
    message.header.stamp.sec, message.header.stamp.nanosec = seconds, nanoseconds
    return message
