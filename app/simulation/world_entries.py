"""Contents of a world: the keys of ``world.yaml``, and their values in mm, rad, kg, N and ns."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from app.files.declared import By, block_of
from app.files.document import Section
from app.files.keys import (
    ROBOT_FILE,
    XACRO_ARGS,
    Block,
    Boolean,
    Choice,
    Frame,
    Key,
    ListOf,
    Number,
    Numbers,
    Text,
)
from app.files.meshes import MESH_PATH, MESH_UNITS, load_mesh
from app.files.paths import resolve_file
from app.geometry import FloatArray, SurfaceMesh, Transform
from app.robot import Robot, load_robot
from app.simulation.errors import WorldError
from app.simulation.world_hand import ORDERED_TIMES, HandEntry, check_interval
from app.synthetic.tracker_model import PRESETS, Jitter, TrackerModel, tracker_preset

Collision = Literal["hull", "parts", "none"]
WORLD_FRAME = "world"


def _mesh(entry: Section) -> SurfaceMesh:
    mesh = entry.section("mesh")
    path = resolve_file(mesh.folder, mesh.text("path"), mesh.place("path"))
    return load_mesh(path, units=mesh.choice("units"), frame=entry.frame("name"))


def _pose(entry: Section, target: str, source: str) -> Transform:
    position: FloatArray = np.array(entry.value("position_mm") or (0.0, 0.0, 0.0))
    turn = entry.value("rotation_deg") or (0.0, 0.0, 0.0)
    return Transform.from_rotation_vector(np.radians(turn), position, target=target, source=source)


def _in_world(entry: Section) -> Transform:
    return _pose(entry, WORLD_FRAME, entry.frame("name"))


_POSE: dict[str, Key] = {
    "position_mm": Numbers("position; default: the origin", 3, optional=True),
    "rotation_deg": Numbers("axis times angle; default: none", 3, optional=True),
}
_MESH = Block(
    "closed surface in the body's own frame",
    {
        "path": Text(MESH_PATH),
        "units": MESH_UNITS,
    },
)

_FRICTION = Number("coefficient of sliding friction", default=0.3, minimum=0.0, maximum=10.0)
_COLLISION = Choice(
    "hull: the convex hull of each surface; parts: an approximate convex decomposition, computed "
    "once and cached; none: touches nothing",
    ("hull", "parts", "none"),
    default="hull",
)

_Mesh = Annotated[SurfaceMesh, "mesh", _MESH, By(_mesh)]
_Friction = Annotated[float, _FRICTION]
_Collision = Annotated[Collision, _COLLISION]


@dataclass(frozen=True, slots=True, eq=False)
class ToolEntry:
    """A tool held by ``link``; ``link_from_tool`` is rigid, ``mesh`` in the tool's frame."""

    name: Annotated[str, Frame("name of the tool")]
    link: Annotated[str, Frame("link that holds it")]
    mesh: _Mesh
    link_from_tool: Annotated[
        Transform, By(lambda tool: _pose(tool, tool.frame("link"), tool.frame("name")))
    ]
    mass_kg: Annotated[float, Number("mass", above=0.0)]
    friction: _Friction
    collision: _Collision


@dataclass(frozen=True, slots=True, eq=False)
class RobotEntry:
    """A robot whose base link is at ``world_from_base``.

    ``positions``: joints at the start, in rad, m for sliding joints. ``max_effort`` and
    ``density_kg_m3`` are for what the robot's file leaves out, None where there is no such value.
    """

    name: str
    robot: Robot
    world_from_base: Transform
    positions: Mapping[str, float]
    density_kg_m3: float | None = None
    max_effort: float | None = None
    armature_kg_m2: float = 0.0
    friction: float = 0.3
    collision: Collision = "hull"
    self_collision: bool = False
    tool: ToolEntry | None = None
    file: Path | None = None


def _robot(entry: Section) -> RobotEntry:
    name = entry.frame("name")
    file = resolve_file(entry.folder, entry.text("file"), entry.place("file"))
    robot = load_robot(file, xacro_args=entry.value("xacro_args"))
    tool: ToolEntry | None = entry.value("tool")
    links = [link.name for link in robot.links]
    if tool is not None and tool.link not in links:
        raise WorldError(
            f"{entry.place('tool')}.link is {tool.link!r}; expected one of {', '.join(links)}"
        )
    same = ("density_kg_m3", "max_effort", "armature_kg_m2", "friction")
    return RobotEntry(
        name,
        robot,
        _pose(entry, WORLD_FRAME, robot.root_link),
        _positions(entry, robot),
        **{key: entry.value(key) for key in (*same, "collision", "self_collision")},
        tool=tool,
        file=file,
    )


def _positions(entry: Section, robot: Robot) -> dict[str, float]:
    positions: dict[str, float] = {}
    for each in entry.value("positions") or ():
        joint = each.text("joint")
        if joint in positions or joint not in robot.actuated_joint_names:
            problem = "given twice" if joint in positions else "no actuated joint"
            raise WorldError(
                f"{each.place('joint')} is {joint!r}: {problem}; expected one of "
                f"{', '.join(robot.actuated_joint_names)}"
            )
        positions[joint] = each.number("position")
    return positions


_ROBOT = Block(
    "a robot; its base link is fixed in the world",
    {
        "name": Frame("name of the robot"),
        "file": ROBOT_FILE,
        "xacro_args": XACRO_ARGS,
        "density_kg_m3": Number(
            "density of the links that the file gives no mass; needed if there are any",
            optional=True,
            above=0.0,
        ),
        "max_effort": Number(
            "limit of the drives that the file gives none, N m or N; needed if there are any",
            optional=True,
            above=0.0,
        ),
        "armature_kg_m2": Number(
            "inertia of each drive's rotor, seen at its joint", default=0.0, minimum=0.0
        ),
        "collision": _COLLISION,
        "self_collision": Boolean(
            "links touch each other, except those that a joint connects", default=False
        ),
        "friction": _FRICTION,
        "positions": ListOf(
            "positions of joints at the start; default 0",
            Block(
                "a joint",
                {
                    "joint": Text("name of an actuated joint"),
                    "position": Number("rad, or m for a sliding joint"),
                },
            ),
            optional=True,
            if_empty="leave it out to start at 0",
        ),
        "tool": block_of(ToolEntry, "tool that a link holds", _POSE, optional=True),
        **_POSE,
    },
    read=_robot,
)


@dataclass(frozen=True, slots=True, eq=False)
class BodyEntry:
    """A rigid body at ``world_from_body``; free with ``mass_kg``, fixed where that is None."""

    name: Annotated[str, Frame("name of the body")]
    mesh: _Mesh
    world_from_body: Annotated[
        Transform,
        {"motion": Choice("fixed in the world, or free to move", ("fixed", "free"))},
        By(_in_world),
    ]
    mass_kg: Annotated[
        float | None, Number("mass of a free body; needed for one", optional=True, above=0.0)
    ]
    friction: _Friction = 0.3
    collision: _Collision = "hull"

    def check(self, block: Section) -> None:
        """Raise `WorldError` unless a free body has a mass, and only a free one."""
        is_free = block.choice("motion") == "free"
        if is_free is (self.mass_kg is None):
            problem = "missing for a free body" if is_free else "given for a fixed body"
            raise WorldError(
                f"{block.place('mass_kg')} is {problem}; expected it for free bodies only"
            )


@dataclass(frozen=True, slots=True, eq=False)
class TissueShift:
    """A displacement (3,) in mm, in the axes of the world, that begins and ends smoothly."""

    start_s: Annotated[float, Number("start", minimum=0.0)]
    end_s: Annotated[float, Number("end, after the start")]
    shift_mm: Annotated[
        FloatArray, Numbers("translation", 3), By(lambda it: np.array(it.numbers("shift_mm")))
    ]

    def check(self, block: Section) -> None:
        """Raise `WorldError` for a displacement without duration."""
        check_interval(block, self.start_s, self.end_s)


_BREATH = Block(
    "displacement at full inspiration, in the axes of the world",
    {
        "shift_mm": Numbers("translation", 3),
        "turn_deg": Numbers("rotation vector about the structure's own origin", 3),
    },
    optional=True,
)


def _breath(tissue: Section, key: str) -> FloatArray:
    breath: Section | None = tissue.value("breathing")
    return np.zeros(3) if breath is None else np.array(breath.numbers(key))


@dataclass(frozen=True, slots=True, eq=False)
class TissueEntry:
    """A structure in soft tissue, at ``rest`` at end expiration.

    ``breath_shift_mm`` (3,) and ``breath_turn_rad`` (3,): displacement at full inspiration.
    """

    name: Annotated[str, Frame("name of the structure")]
    mesh: _Mesh
    rest: Annotated[Transform, By(_in_world)]
    breath_shift_mm: Annotated[
        FloatArray, {"breathing": _BREATH}, By(lambda tissue: _breath(tissue, "shift_mm"))
    ]
    breath_turn_rad: Annotated[
        FloatArray, By(lambda tissue: np.radians(_breath(tissue, "turn_deg")))
    ]
    shifts: Annotated[
        tuple[TissueShift, ...],
        ListOf(
            "smooth displacements that stay, in the axes of the world",
            block_of(TissueShift, "a displacement", rules=(ORDERED_TIMES,)),
            optional=True,
            if_empty="leave it out for none",
        ),
    ] = ()


@dataclass(frozen=True, slots=True)
class BreathingEntry:
    """Frequency of the breaths, and until when the breath is held at end expiration."""

    frequency_hz: Annotated[
        float, Number("breaths per second", default=0.25, above=0.0, maximum=5.0)
    ] = 0.25
    held_until_s: Annotated[
        float, Number("the breath is held until then", default=0.0, minimum=0.0)
    ] = 0.0


def _of_model(description: str, minimum: float, maximum: float) -> Number:
    text = f"{description}; default: that of the model"
    return Number(text, optional=True, minimum=minimum, maximum=maximum)


_MODEL = {
    "model": Choice(
        "a real tracker, or white: regular times and 0.3 mm and 0.3 degrees of white noise",
        tuple(PRESETS),
        default="white",
    ),
    "rate_hz": _of_model("samples per second", 1.0, 250.0),
    "latency_ms": _of_model("from acquisition to stamp and arrival", 0.0, 200.0),
    "white_rms_mm": _of_model("RMS length of the white error of positions", 0.0, 5.0),
    "white_rms_deg": _of_model("RMS angle of the white error of rotations", 0.0, 5.0),
    "slow_rms_mm": _of_model("the same of the correlated error", 0.0, 5.0),
    "slow_rms_deg": _of_model("the same of the correlated error", 0.0, 5.0),
    "correlation_ms": _of_model("correlation time of that error", 1.0, 60_000.0),
}


def _model(tracker: Section) -> TrackerModel:
    model = tracker_preset(tracker.choice("model"))

    def given(key: str, default: float, factor: float = 1.0) -> float:
        return factor * tracker.number(key) if key in tracker else default

    def jitter(kind: str, default: Jitter) -> Jitter:
        return Jitter(
            given(f"{kind}_rms_mm", default.position_rms_mm),
            given(f"{kind}_rms_deg", default.angle_rms_rad, math.radians(1.0)),
        )

    return replace(
        model,
        rate_hz=given("rate_hz", model.rate_hz),
        latency_s=given("latency_ms", model.latency_s, 1e-3),
        white=jitter("white", model.white),
        slow=jitter("slow", model.slow),
        correlation_s=given("correlation_ms", model.correlation_s, 1e-3),
    )


@dataclass(frozen=True, slots=True, eq=False)
class TrackerEntry:
    """Frames that the tracker measures, and the errors of the measurement.

    ``metal``: an arm and two of its links, between which its metal distorts the field.
    """

    tracked: Annotated[
        tuple[str, ...],
        ListOf(
            "tools, bodies and tissues that carry a sensor",
            Text("name"),
            if_empty="expected names",
        ),
    ]
    model: Annotated[TrackerModel, _MODEL, By(_model)]
    metal: tuple[str, str, str] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class WorldDescription:
    """Everything that is simulated; ``gravity_m_s2`` is along -z of the world."""

    name: str
    seed: int
    timestep_ns: int = 1_000_000
    gravity_m_s2: float = 9.80665
    robots: tuple[RobotEntry, ...] = ()
    bodies: tuple[BodyEntry, ...] = ()
    tissues: tuple[TissueEntry, ...] = ()
    breathing: BreathingEntry = BreathingEntry()
    tracker: TrackerEntry | None = None
    hand: HandEntry | None = None


PARTS: dict[str, Key] = {
    "robots": ListOf("robots", _ROBOT, optional=True, if_empty="leave it out for none"),
    "bodies": ListOf(
        "bodies",
        block_of(BodyEntry, "a rigid body", _POSE),
        optional=True,
        if_empty="leave it out for none",
    ),
    "tissues": ListOf(
        "soft tissue",
        block_of(
            TissueEntry,
            "a structure that breathing and shifts of the tissue move; nothing resists it",
            _POSE,
        ),
        optional=True,
        if_empty="leave it out for none",
    ),
    "breathing": block_of(BreathingEntry, "breathing of the patient", optional=True),
    "tracker": block_of(
        TrackerEntry, "the tracker that measures poses; default: none", optional=True
    ),
}
