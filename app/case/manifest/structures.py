"""Schema 2: lists of structures, tools and robots, the same in ``case.yaml`` and ``live.yaml``."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, Literal

from app.case.manifest.display_items import ItemEntry
from app.case.manifest.key_rules import (
    MARGINS,
    REFERENCE_FRAME,
    MarginEntry,
    StructureMargins,
    read_pose,
)
from app.case.manifest.parts import (
    PARTS,
    TUMOR_MESH_FRAME,
    ToolEntry,
    TumorEntry,
)
from app.case.manifest.robot import (
    ROBOT,
    RegistrationEntry,
    RobotEntry,
    read_registration,
)
from app.files.declared import block_of, read_as, value_as
from app.files.document import Section
from app.files.keys import Block, Choice, Frame, Key, ListOf, Number, Text
from app.geometry import InputError

MAX_STRUCTURES = 100

_OWN_MARGINS = tuple(each.name for each in fields(StructureMargins))
"""Margins that each structure has; the others are those of the case."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StructureEntry(TumorEntry):
    """A structure of its own name, which is also that of the frame of its shape."""

    name: Annotated[str, Frame("name, which no frame has")]
    role: Annotated[
        Literal["target", "forbidden"],
        Choice(
            "target: a tumour, removed with its margin; forbidden: a vessel, a nerve, the chest "
            "wall",
            ("target", "forbidden"),
        ),
    ]
    margins: Annotated[
        StructureMargins,
        block_of(StructureMargins, "distances", rules=("warn_mm is more than stop_mm",)),
    ]

    @property
    def key(self) -> str:
        """The manifest's key of the structure, for messages."""
        return f"structures.{self.name}"


def _read_structure(block: Section) -> StructureEntry:
    pose = read_pose(block, "pose", target=block.frame("frame"), source=block.frame("name"))
    return replace(read_as(StructureEntry, block), frame_from_tumor=pose)


STRUCTURES = ListOf(
    "tumours and what must not be touched; the first target is the tumour whose frame the "
    "constraint is in",
    replace(
        block_of(StructureEntry, "a structure", variants=PARTS["tumor"].variants),
        read=_read_structure,
    ),
    if_empty="expected at least one target",
)


@dataclass(frozen=True, slots=True, eq=False)
class ArmEntry:
    """A tool, and the robot that holds it with its registration; None for one held by hand."""

    name: str
    tool: ToolEntry
    robot: RobotEntry | None = None
    registration: RegistrationEntry | None = None

    @property
    def mesh_key(self) -> str:
        """The manifest's key of its mesh, for messages."""
        return f"tools.{self.name}.mesh"


_TOOL = PARTS["tool"]
TOOLS = ListOf(
    "tracked tools, each with a constraint of its own",
    replace(_TOOL, keys={"name": Text("name of the tool"), **_TOOL.keys}, read=None),
    if_empty="expected at least one",
)

TOOL_DISTANCE = Number(
    "distance in mm up to which another tool is a warning; without it the distance between tools "
    "is not checked",
    optional=True,
    above=0.0,
    maximum=200.0,
)


def robots_of(registration: Key) -> ListOf:
    """The key ``robots`` of a document in which each has this ``registration``."""
    keys = {
        "name": Text("name of the robot"),
        "holds": Text("name of the tool that it holds"),
        **ROBOT.keys,
        "registration": replace(registration, optional=False),
    }
    return ListOf(
        "robots that hold tools; a tool that none holds is held by hand",
        replace(ROBOT, optional=False, keys=keys, read=None),
        optional=True,
    )


def _read_margins(block: Section) -> Mapping[str, Any]:
    names = (each.name for each in fields(MarginEntry) if each.name not in _OWN_MARGINS)
    return {name: value_as(block, name) for name in names}


MARGINS_OF_ALL = Block(
    "margins that all structures share, and the age at which data are stale",
    {name: key for name, key in MARGINS.keys.items() if name not in _OWN_MARGINS},
    rules=MARGINS.rules[1:],
    read=_read_margins,
)

IN_LISTS = ("tool", "tumor", "robot", "registration")
"""Keys of schema 1 in whose place schema 2 has lists."""

DIFFERENT = "structures, tools and robots have different names, and frames that fit them"
MEASURABLE = "tool_distance_mm needs several tools, each with a mesh"


def read_structures(document: Section) -> tuple[StructureEntry, ...]:
    """Read ``structures``, the first target first; `InputError` without a target."""
    found: tuple[StructureEntry, ...] = document.value("structures")
    if len(found) > MAX_STRUCTURES:
        raise InputError(
            f"{document.place('structures')} has {len(found)}; expected at most {MAX_STRUCTURES}"
        )
    _check_names(document, "structures", [each.name for each in found])
    first = next((each for each in found if each.role == "target"), None)
    if first is None:
        raise InputError(
            f"{document.place('structures')} has no target; expected at least one: what is removed"
        )
    return (first, *(each for each in found if each is not first))


def check_own_names(
    document: Section,
    structures: Sequence[StructureEntry],
    arms: Sequence[ArmEntry],
    items: Iterable[ItemEntry],
) -> None:
    """Raise `InputError` for a structure with the name of another frame, which would be a loop."""
    names = [*(each.name for each in structures), *(arm.name for arm in arms)]
    _check_names(document, "structures and tools", names)
    frames = {REFERENCE_FRAME, *(each.frame for each in structures)}
    frames |= {name for arm in arms for name in (arm.tool.frame, arm.tool.tip_frame)}
    frames |= {arm.robot.base_frame for arm in arms if arm.robot is not None}
    frames |= {each.frame for each in items}
    for each in structures:
        if each.name in frames:
            raise InputError(
                f"{document.place('structures')}: the name {each.name!r} is that of another "
                "frame; expected a name of its own"
            )


def read_arms(document: Section) -> tuple[ArmEntry, ...]:
    """Read ``tools`` and the ``robots`` that hold them."""
    tools = {}
    sections = document.sections("tools")
    _check_names(document, "tools", [each.text("name") for each in sections])
    for section in sections:
        tools[section.text("name")] = ArmEntry(section.text("name"), read_as(ToolEntry, section))
    robots = document.sections("robots") if "robots" in document else ()
    _check_names(document, "robots", [each.text("name") for each in robots])
    for section in robots:
        name = section.text("holds")
        if name not in tools:
            raise InputError(
                f"{section.place('holds')} is {name!r}; expected one of {', '.join(tools)}"
            )
        if tools[name].robot is not None:
            raise InputError(
                f"{section.place('holds')} is {name!r}, which another robot holds; "
                "expected one robot for a tool"
            )
        robot = read_as(RobotEntry, section)
        registration = read_registration(section, robot)
        tools[name] = replace(tools[name], robot=robot, registration=registration)
    arms = tuple(tools.values())
    _check_names(
        document, "robots", [arm.robot.base_frame for arm in arms if arm.robot], "base_frame"
    )
    tips = [name for arm in arms for name in (arm.tool.frame, arm.tool.tip_frame)]
    _check_names(document, "tools", tips, "frame")
    return arms


def read_tool_distance(document: Section, arms: Sequence[ArmEntry]) -> float | None:
    """Read ``tool_distance_mm``, None without it; `InputError` unless it can be measured."""
    if "tool_distance_mm" not in document:
        return None
    place = document.place("tool_distance_mm")
    if len(arms) < 2:
        raise InputError(f"{place} is given with one tool; expected another one in tools")
    for arm in arms:
        if arm.tool.mesh is None:
            raise InputError(f"{place} is given, but {arm.mesh_key} is missing; expected one")
    return document.number("tool_distance_mm")


def margins_of(of_all: Mapping[str, Any], own: StructureMargins) -> MarginEntry:
    """The margins of a structure with its ``own`` distances."""
    return MarginEntry(stop_mm=own.stop_mm, warn_mm=own.warn_mm, **of_all)


def _check_names(document: Section, key: str, names: Sequence[str], what: str = "name") -> None:
    for name in names:
        if names.count(name) > 1:
            raise InputError(
                f"{document.place(key)}: {names.count(name)} have the {what} {name!r}; "
                "expected another one for each"
            )


def as_schema_2(values: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a valid document of schema 1 in schema 2, which means the same."""
    found: dict[str, Any] = {}
    for key, value in values.items():
        match key:
            case "schema":
                found[key] = 2
            case "tool":
                found["tools"] = [{"name": value["frame"], **value}]
            case "tumor":
                own = {name: values["margins"][name] for name in _OWN_MARGINS}
                found["structures"] = [
                    {"name": TUMOR_MESH_FRAME, "role": "target", **value, "margins": own}
                ]
            case "robot":
                robot = {"name": value["base_frame"], "holds": values["tool"]["frame"], **value}
                found["robots"] = [{**robot, "registration": values["registration"]}]
            case "margins":
                found[key] = {
                    name: number for name, number in value.items() if name not in _OWN_MARGINS
                }
            case "registration":
                continue  # that of the robot; without one it registers nothing
            case _:
                found[key] = value
    return found


@dataclass(frozen=True, slots=True)
class PlainParts:
    """Mappings of the values of a valid document of either schema, to be edited in place.

    ``tool`` is the guarded one and ``tumor`` that of `CaseManifest`; ``placed`` has the key
    ``registration``.
    """

    values: dict[str, Any]
    tool: dict[str, Any]
    tumor: dict[str, Any]
    placed: dict[str, Any]

    @classmethod
    def of(cls, values: dict[str, Any], tool_frame: str) -> "PlainParts":
        """The parts of ``values``, whose guarded tool is tracked as ``tool_frame``."""
        if values["schema"] == 1:
            return cls(values, values["tool"], values["tumor"], values)
        tool = next(each for each in values["tools"] if each["frame"] == tool_frame)
        tumor = next(each for each in values["structures"] if each["role"] == "target")
        held = (each for each in values.get("robots", ()) if each["holds"] == tool["name"])
        return cls(values, tool, tumor, next(held, {}))

    def set_margins(self, margins: Mapping[str, Any]) -> None:
        """Replace the margins of the tumour and those that all structures share."""
        if self.values["schema"] == 1:
            self.values["margins"] = dict(margins)
            return
        self.tumor["margins"] = {name: margins[name] for name in _OWN_MARGINS}
        self.values["margins"] = {
            name: number for name, number in margins.items() if name not in _OWN_MARGINS
        }
