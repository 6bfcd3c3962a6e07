"""Reads ``world.yaml`` and loads the robots and meshes that it names."""

from dataclasses import replace
from pathlib import Path

from app.files.bounded_io import is_file, is_folder
from app.files.document import Section
from app.files.keys import Block, Integer, Number, Text
from app.geometry import NS_PER_MS, MarginGuardError
from app.simulation.errors import WorldError
from app.simulation.world_entries import PARTS, WORLD_FRAME, BreathingEntry, WorldDescription
from app.simulation.world_hand import HAND

WORLD_FILE = "world.yaml"

MAX_TIMESTEP_MS = 2.0
"""Contacts and loops are stiff on the scale of two steps: longer ones could not hold them."""

FILES = "the named files exist and have a known format"
UNIQUE_NAMES = "names of robots, tools, bodies and tissues differ from each other"
KNOWN_NAMES = "hand.robot is a robot, towards and tracked name a tool, a body or a tissue"

_PHYSICS = Block(
    "the physics engine",
    {
        "timestep_ms": Number("time step", default=1.0, above=0.0, maximum=MAX_TIMESTEP_MS),
        "gravity_mm_s2": Number("along -z of the world", default=9806.65, minimum=0.0),
    },
    optional=True,
)

WORLD = Block(
    "a simulated world",
    {
        "schema": Integer("version of the format", 1, 1),
        "name": Text("name of the world, shown in reports"),
        "seed": Integer("of all random numbers", 0, 2**32 - 1),
        "physics": _PHYSICS,
        **PARTS,
        "hand": HAND,
    },
    rules=(FILES, UNIQUE_NAMES, KNOWN_NAMES),
)


def open_world(path: Path) -> WorldDescription:
    """Read the world file at ``path``, or ``world.yaml`` in that folder, with all its files.

    Raises `WorldError`, or the error of the robot or mesh, for the first fault.
    """
    file = path / WORLD_FILE if is_folder(path) else path
    if not is_file(file):
        raise WorldError(f"{path} is not a world; expected a {WORLD_FILE} or its folder")
    try:
        return read_world(Section.load(file, WORLD))
    except WorldError:
        raise
    except MarginGuardError as error:
        raise WorldError(str(error)) from error


def read_world(document: Section) -> WorldDescription:
    """Read a document with the keys of `WORLD`."""
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
        document.value("robots") or (),
        document.value("bodies") or (),
        document.value("tissues") or (),
        document.value("breathing") or BreathingEntry(),
        document.value("tracker"),
        document.value("hand"),
    )
    holder = next((entry for entry in world.robots if entry.tool is not None), None)
    if world.tracker is not None and holder is not None and holder.tool is not None:
        metal = (holder.name, holder.robot.root_link, holder.tool.link)
        world = replace(world, tracker=replace(world.tracker, metal=metal))
    _check_names(document, world)
    return world


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
