"""Reads ``world.yaml`` and loads the robots and meshes that it names."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np

from app.files.bounded_io import is_file, is_folder
from app.files.document import Section
from app.files.meshes import load_mesh
from app.files.paths import resolve_file
from app.geometry import (
    NS_PER_MS,
    FloatArray,
    MarginGuardError,
    SurfaceMesh,
    Transform,
)
from app.robot import load_robot
from app.simulation.errors import WorldError
from app.simulation.hand_block import read_hand, read_interval
from app.simulation.world_entries import (
    WORLD_FRAME,
    BodyEntry,
    BreathingEntry,
    Collision,
    RobotEntry,
    TissueEntry,
    TissueShift,
    ToolEntry,
    TrackerEntry,
    WorldDescription,
)
from app.simulation.world_keys import WORLD
from app.synthetic.presets import tracker_preset
from app.synthetic.tracker import Jitter

WORLD_FILE = "world.yaml"


def open_world(path: Path) -> WorldDescription:
    """Read the world file at ``path``, or ``world.yaml`` in that folder, with all its files.

    Raises `WorldError`, or the error of the robot or mesh, for the first fault.
    """
    file = path / WORLD_FILE if is_folder(path) else path
    if not is_file(file):
        raise WorldError(f"{path} is not a world; expected a {WORLD_FILE} or its folder")
    try:
        return read_world(Section.load(file, WORLD), file.parent)
    except WorldError:
        raise
    except MarginGuardError as error:
        raise WorldError(str(error)) from error


def read_world(document: Section, folder: Path) -> WorldDescription:
    """Read a document with the keys of `WORLD`; relative names of files are in ``folder``."""
    document.integer("schema")
    timestep_ms, gravity_mm_s2 = 1.0, 9806.65
    if "physics" in document:
        physics = document.section("physics")
        timestep_ms = physics.number("timestep_ms")
        gravity_mm_s2 = physics.number("gravity_mm_s2")
    world = WorldDescription(
        document.text("name"),
        document.integer("seed"),
        max(1, round(timestep_ms * NS_PER_MS)),
        gravity_mm_s2 / 1000.0,
        tuple(_robot(each, folder) for each in _entries(document, "robots")),
        tuple(_body(each, folder) for each in _entries(document, "bodies")),
        tuple(_tissue(each, folder) for each in _entries(document, "tissues")),
        _breathing(document),
        None,
        read_hand(document.section("hand")) if "hand" in document else None,
    )
    if "tracker" in document:
        tracker = _tracker(document.section("tracker"), world.robots)
        world = replace(world, tracker=tracker)
    _check_names(document, world)
    return world


def _entries(document: Section, key: str) -> tuple[Section, ...]:
    return document.sections(key) if key in document else ()


def _robot(block: Section, folder: Path) -> RobotEntry:
    name = block.frame("name")
    file = resolve_file(folder, block.text("file"), block.place("file"))
    args = block.texts_by_name("xacro_args") if "xacro_args" in block else None
    robot = load_robot(file, xacro_args=args)
    positions: dict[str, float] = {}
    for each in _entries(block, "positions"):
        joint = each.text("joint")
        if joint in positions or joint not in robot.actuated_joint_names:
            problem = "given twice" if joint in positions else "no actuated joint"
            raise WorldError(
                f"{each.place('joint')} is {joint!r}: {problem}; expected one of "
                f"{', '.join(robot.actuated_joint_names)}"
            )
        positions[joint] = each.number("position")
    tool = _tool(block.section("tool"), folder) if "tool" in block else None
    if tool is not None and tool.link not in {link.name for link in robot.links}:
        raise WorldError(
            f"{block.place('tool')}.link is {tool.link!r}; expected one of "
            f"{', '.join(link.name for link in robot.links)}"
        )
    return RobotEntry(
        name,
        robot,
        _pose(block, WORLD_FRAME, robot.root_link),
        positions,
        density_kg_m3=block.number("density_kg_m3") if "density_kg_m3" in block else None,
        max_effort=block.number("max_effort") if "max_effort" in block else None,
        armature_kg_m2=block.number("armature_kg_m2"),
        friction=block.number("friction"),
        collision=_collision(block),
        self_collision=block.boolean("self_collision"),
        tool=tool,
        file=file,
    )


def _tool(block: Section, folder: Path) -> ToolEntry:
    name, link = block.frame("name"), block.frame("link")
    return ToolEntry(
        name,
        link,
        _mesh(block, folder, name),
        _pose(block, link, name),
        block.number("mass_kg"),
        block.number("friction"),
        _collision(block),
    )


def _body(block: Section, folder: Path) -> BodyEntry:
    name, is_free = block.frame("name"), block.choice("motion") == "free"
    if is_free != ("mass_kg" in block):
        problem = "missing for a free body" if is_free else "given for a fixed body"
        raise WorldError(f"{block.place('mass_kg')} is {problem}; expected it for free bodies only")
    return BodyEntry(
        name,
        _mesh(block, folder, name),
        _pose(block, WORLD_FRAME, name),
        block.number("mass_kg") if is_free else None,
        block.number("friction"),
        _collision(block),
    )


def _tissue(block: Section, folder: Path) -> TissueEntry:
    name = block.frame("name")
    shift, turn = np.zeros(3), np.zeros(3)
    if "breathing" in block:
        breathing = block.section("breathing")
        shift = np.array(breathing.numbers("shift_mm"))
        turn = np.radians(breathing.numbers("turn_deg"))
    return TissueEntry(
        name,
        _mesh(block, folder, name),
        _pose(block, WORLD_FRAME, name),
        shift,
        turn,
        tuple(
            TissueShift(*read_interval(each), np.array(each.numbers("shift_mm")))
            for each in _entries(block, "shifts")
        ),
    )


def _breathing(document: Section) -> BreathingEntry:
    if "breathing" not in document:
        return BreathingEntry()
    block = document.section("breathing")
    return BreathingEntry(block.number("frequency_hz"), block.number("held_until_s"))


def _tracker(block: Section, robots: Sequence[RobotEntry]) -> TrackerEntry:
    """Read ``tracker``; the metal is the first robot that holds a tool, from base to tool."""
    model = tracker_preset(block.choice("model"))

    def given(key: str, default: float, factor: float = 1.0) -> float:
        return factor * block.number(key) if key in block else default

    degree = math.radians(1.0)
    model = replace(
        model,
        rate_hz=given("rate_hz", model.rate_hz),
        latency_s=given("latency_ms", model.latency_s, 1e-3),
        white=_jitter(given, "white", model.white, degree),
        slow=_jitter(given, "slow", model.slow, degree),
        correlation_s=given("correlation_ms", model.correlation_s, 1e-3),
    )
    metal = None
    holder = next((entry for entry in robots if entry.tool is not None), None)
    if holder is not None and holder.tool is not None:
        metal = (holder.name, holder.robot.root_link, holder.tool.link)
    return TrackerEntry(block.texts("tracked"), model, metal)


def _jitter(given: Callable[..., float], kind: str, default: Jitter, degree: float) -> Jitter:
    return Jitter(
        given(f"{kind}_rms_mm", default.position_rms_mm),
        given(f"{kind}_rms_deg", default.angle_rms_rad, degree),
    )


def _collision(block: Section) -> Collision:
    return cast(Collision, block.choice("collision"))


def _mesh(block: Section, folder: Path, frame: str) -> SurfaceMesh:
    mesh = block.section("mesh")
    path = resolve_file(folder, mesh.text("path"), mesh.place("path"))
    return load_mesh(path, units=mesh.choice("units"), frame=frame)


def _pose(block: Section, target: str, source: str) -> Transform:
    position: FloatArray = np.zeros(3)
    if "position_mm" in block:
        position = np.array(block.numbers("position_mm"))
    turn = block.numbers("rotation_deg") if "rotation_deg" in block else (0.0, 0.0, 0.0)
    return Transform.from_rotation_vector(np.radians(turn), position, target=target, source=source)


def _check_names(document: Section, world: WorldDescription) -> None:
    tools = [entry.tool.name for entry in world.robots if entry.tool is not None]
    movable = [*tools, *(e.name for e in world.bodies), *(e.name for e in world.tissues)]
    names = [*(entry.name for entry in world.robots), *movable, WORLD_FRAME]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise WorldError(f"{document.place('name')} {twice!r} is used twice; expected unique names")
    if world.hand is not None:
        of = next((entry for entry in world.robots if entry.name == world.hand.robot), None)
        if of is None or of.tool is None:
            raise WorldError(
                f"{document.place('hand')}.robot is {world.hand.robot!r}; "
                "expected the name of a robot with a tool"
            )
    pushed_at = [push.towards for push in world.hand.pushes] if world.hand else []
    tracked = list(world.tracker.tracked) if world.tracker else []
    for place, named in (("hand.pushes", pushed_at), ("tracker.tracked", tracked)):
        unknown = next((name for name in named if name not in movable), None)
        if unknown is not None:
            raise WorldError(
                f"{document.place(place)} names {unknown!r}; expected one of "
                f"{', '.join(movable) or 'none'}"
            )
