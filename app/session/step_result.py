"""Result of one step of a session, the edges that it used, and its form for other processes."""

import io
import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from app.case import JointSample, TrackingFrame
from app.fixture import FixtureDecision, MarginState, Proximity
from app.geometry import (
    Edge,
    FloatArray,
    FrameError,
    Stamp,
    TrackedTransform,
    Transform,
    product_along,
    shortest_path,
    slot_setters,
)
from app.registration import RegistrationDrift
from app.robot import Robot
from app.robot.kinematic_tree import LinkPoses
from app.session.path_depth import PathDepth
from app.session.setup import RobotSetup
from app.session.structure import StructureStep, governing_number
from app.session.tool_distances import ToolDistance

_NOTHING: Mapping[Any, Any] = {}


class KnownEdges(NamedTuple):
    """Static edges, measured edges and links of the robot, as the step used them.

    ``measured`` holds the latest sample of each edge, None if it may not be used at this step
    (lost, stale, frozen, from the future). ``links`` holds ``root_from_link`` from joints of
    ``links_stamp``, empty if they are not known; ``link_names`` names them in any case. The frame
    ``base`` is the root link ``root``.
    """

    static: tuple[Transform, ...] = ()
    measured: Mapping[Edge, TrackedTransform | None] = _NOTHING
    links: Mapping[str, Transform] = _NOTHING
    links_stamp: Stamp | None = None
    link_names: frozenset[str] = frozenset()
    base: str = ""
    root: str = ""

    def frames(self) -> frozenset[str]:
        """Names of all frames of these edges, also of those that may not be used now."""
        static = {name for edge in self.static for name in (edge.target, edge.source)}
        measured = {name for edge in self.measured for name in edge}
        robot = {self.base, self.root, *self.link_names} - {""}
        return frozenset(static | measured | robot)

    def between(self, target: str, source: str) -> tuple[Transform, Stamp | None]:
        """``target_from_source`` and the stamp of its oldest sample, None for static edges alone.

        Raises `FrameError` if they are not connected, or by an edge that may not be used.
        """
        edges: dict[Edge, tuple[Transform, Stamp | None] | None] = {}
        for edge, sample in self.measured.items():
            pose = None if sample is None else sample.transform
            edges[edge] = None if sample is None or pose is None else (pose, sample.stamp)
        edges |= {(edge.target, edge.source): (edge, None) for edge in self.static}
        for name in self.link_names - {self.root}:
            link = self.links.get(name)
            edges[self.root, name] = None if link is None else (link, self.links_stamp)
        if self.base != self.root:
            identity = Transform.identity(self.base, self.root)
            edges[self.base, self.root] = (identity, None)
        path = shortest_path(edges, target, source)
        if path is None:
            raise FrameError(f"{source!r} is not connected with {target!r} in the session")
        transforms, stamps = [], []
        for edge in path:
            known = edges[edge]
            if known is None:
                raise FrameError(f"{edge[1]!r} in {edge[0]!r} is not known now")
            transforms.append(known[0])
            stamps.append(known[1])
        oldest = min((stamp for stamp in stamps if stamp is not None), default=None)
        return product_along(target, transforms), oldest


NO_EDGES = KnownEdges()
"""Edges of a step whose frames are not known."""


def known_edges(
    static: tuple[Transform, ...],
    robot: RobotSetup | None,
    measured: Mapping[Edge, TrackedTransform | None],
    links: Mapping[str, Transform],
    joints: JointSample | None,
) -> KnownEdges:
    """The edges of a step with ``links`` of ``robot`` from the latest ``joints``.

    Links that follow the tool by inverse kinematics are a picture and not a measurement: they are
    not known.
    """
    if robot is None:
        return KnownEdges(static, measured)
    if robot.follows_tool:
        base = robot.base_frame
        return KnownEdges(static, measured, base=base, root=base)
    return KnownEdges(
        static,
        measured,
        links,
        None if joints is None else joints.stamp,
        _link_names(robot.robot),
        robot.base_frame,
        robot.robot.root_link,
    )


@lru_cache(maxsize=4)  # called in every step of a session, which has one robot
def _link_names(robot: Robot) -> frozenset[str]:
    return frozenset(link.name for link in robot.links)


@dataclass(frozen=True, slots=True, eq=False)
class StepResult:
    """Result of one step.

    ``tumor_from_tip`` is None when the tool or the tumour is not known. ``links`` holds
    ``root_from_link`` for every link of the robot; ``robot_problem`` is the reason if it is empty
    although there is a robot. ``virtual_fixture`` is ``tumor_from_virtual_fixture``, None without a
    constraint. ``drift`` is the difference between the tracked tool and the tool predicted from
    joints and registration, None if one of them is not known. ``frames_problems`` describe errors
    in the frames that the tracker measures, each as ``<kind>: <details>`` or as a sentence;
    ``frames_problem`` joins them, empty if there is none. ``playback`` describes a recording that
    is played on the graph of a live session, empty if there is none.
    ``hold_causes`` are texts on what began and prolonged the present hold, oldest first; empty
    without a hold. ``single_source`` is True if nothing independent can contradict the tracker.
    ``edges`` are those that the step used, for twists in other frames. ``between_frames`` is the
    deepest point on the path from the last known pose if the tool passed through the tumour there
    and is outside at both ends; the decision's proximity is then that of this point.
    ``structures`` are the decisions on each structure, the tumour first; empty for the tumour
    alone. ``decision`` is then that on all of them (`app.session.combined_decision`), and
    ``half_spaces_of`` the number of the structure of each half-space. ``off`` as in `SessionSetup`.
    ``tools``: distances of the other tools, which are no part of the decision.

    >>> import marginguard as mg
    >>> case = mg.open_case(mg.example_case())
    >>> step = next(mg.replay(case))
    >>> step.index, step.decision.state.name, str(step.decision.reasons[0])
    (0, 'NEGATIVE', 'clear')
    """

    index: int
    frame: TrackingFrame
    decision: FixtureDecision
    tumor_from_tip: Transform | None
    virtual_fixture: Transform | None
    links: Mapping[str, Transform]
    joints: JointSample | None
    robot_problem: str = ""
    drift: RegistrationDrift | None = None
    frames_problems: tuple[str, ...] = ()
    playback: str = ""
    hold_causes: tuple[str, ...] = ()
    single_source: bool = False
    edges: KnownEdges = NO_EDGES
    between_frames: PathDepth | None = None
    structures: tuple[StructureStep, ...] = ()
    half_spaces_of: tuple[int, ...] = ()
    off: Mapping[str, str] = field(default_factory=dict)
    tools: tuple[ToolDistance, ...] = ()

    def of(self, name: str) -> "StepResult":
        """The step as that of a session with the structure ``name`` alone, without its hold.

        The step itself where the session has one structure. Raises `KeyError` for another name.
        """
        if not self.structures:
            return self
        one = {each.name: each for each in self.structures}[name]
        return replace(
            self,
            decision=one.decision,
            tumor_from_tip=one.structure_from_tip,
            between_frames=one.between_frames,
            structures=(),
        )

    @property
    def governing(self) -> StructureStep | None:
        """The structure whose state, distance and margin ``decision`` has; None for one alone."""
        return self.structures[governing_number(self.structures)] if self.structures else None

    @property
    def of_tumor(self) -> "StepResult":
        """The step as that of a session with the tumour alone."""
        return self.of(self.structures[0].name) if self.structures else self

    @property
    def warnings(self) -> tuple[str, ...]:
        """A sentence for each other tool that is near or at a distance that is not known."""
        return tuple(each.warning for each in self.tools if each.warning)

    @property
    def frames_problem(self) -> str:
        """All of ``frames_problems``, joined by semicolons."""
        return "; ".join(self.frames_problems)

    @property
    def distrust(self) -> str:
        """The reason why the poses are good for no plan and no guidance; empty if they are."""
        if self.decision.state is not MarginState.UNKNOWN:
            return ""
        reasons = ", ".join(map(str, self.decision.reasons))
        return f"margin: is UNKNOWN ({reasons}); expected a known one"


_Reduced = tuple[Callable[..., Any], tuple[Any, ...]]

_VALUES: tuple[type, ...] = (
    *(StepResult, TrackingFrame, TrackedTransform, JointSample, Stamp),
    *(Proximity, RegistrationDrift, LinkPoses),
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
