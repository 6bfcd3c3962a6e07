"""Pickles steps for another process, several times faster than `pickle.dumps` does."""

import io
import pickle
from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any

import numpy as np

from app.case import JointSample, TrackingFrame
from app.fixture import AppliedMargin, FixtureDecision, Proximity
from app.geometry import FloatArray, Stamp, TrackedTransform, Transform, slot_setters
from app.registration import RegistrationDrift
from app.robot.kinematics.link_poses import LinkPoses
from app.session.known_edges import NO_EDGES, KnownEdges
from app.session.step_result import StepResult

_Reduced = tuple[Callable[..., Any], tuple[Any, ...]]

_VALUES: tuple[type, ...] = (
    *(StepResult, TrackingFrame, TrackedTransform, JointSample, Stamp, FixtureDecision),
    *(AppliedMargin, Proximity, RegistrationDrift, LinkPoses),
)
"""Classes with slots for all of their values."""


def pickled_steps(steps: Sequence[StepResult]) -> bytes:
    """A list of ``steps`` for `pickle.loads`, without the ``edges`` of each, which are `NO_EDGES`.

    Arrays are read-only afterwards.
    """
    stream = io.BytesIO()
    _Pickler(stream).dump(list(steps))
    return stream.getvalue()


def _restored(setters_of: type, *values: Any) -> Any:
    made: Any = object.__new__(setters_of)
    for assign, value in zip(_SETTERS[setters_of], values, strict=True):
        assign(made, value)
    return made


def _reducer(value_type: type) -> Callable[[Any], _Reduced]:
    values_of = attrgetter(*vars(value_type)["__slots__"])
    return lambda value: (_restored, (value_type, *values_of(value)))


def _transform(target: str, source: str, data: bytes) -> Transform:
    numbers = np.frombuffer(data)
    return Transform.of_read_only(target, source, numbers[:9].reshape(3, 3), numbers[9:])


def _reduced_transform(value: Transform) -> _Reduced:
    data = value.rotation.tobytes() + value.translation_mm.tobytes()
    return _transform, (value.target, value.source, data)


def _array(data: bytes, kind: str, shape: tuple[int, ...]) -> FloatArray:
    return np.frombuffer(data, kind).reshape(shape)


def _reduced_array(value: FloatArray) -> _Reduced:
    return _array, (value.tobytes(), value.dtype.str, value.shape)


def _no_edges() -> KnownEdges:
    return NO_EDGES


_SETTERS = {value_type: slot_setters(value_type) for value_type in _VALUES}


class _Pickler(pickle.Pickler):
    def __init__(self, stream: io.BytesIO) -> None:
        super().__init__(stream, pickle.HIGHEST_PROTOCOL)
        self.dispatch_table = _REDUCERS


_REDUCERS: dict[type, Callable[[Any], _Reduced]] = {
    **{value_type: _reducer(value_type) for value_type in _VALUES},
    Transform: _reduced_transform,
    KnownEdges: lambda _: (_no_edges, ()),
    np.ndarray: _reduced_array,
    np.bool_: lambda value: (bool, (int(value),)),
}
