"""``case.yaml``: its keys, its values and their reader.

Every matrix is a `Transform` in mm, every duration an integer in ns.
"""

import re
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from app.case.manifest.display_items import (
    DISPLAY_ITEMS,
    ENERGY_DEVICE,
    ItemEntry,
    RodEntry,
    check_item_frames,
)
from app.case.manifest.images import (
    ACTIVATION,
    IMAGES,
    ActivationEntry,
    ImagesEntry,
    read_activation,
    read_images,
)
from app.case.manifest.key_rules import MARGINS, YEAR_MS, MarginEntry
from app.case.manifest.parts import (
    PARTS,
    MeshEntry,
    ToolEntry,
    TumorEntry,
    check_frames,
)
from app.case.manifest.plausibility import PLAUSIBILITY, PlausibilityEntry
from app.case.manifest.robot import (
    PACKAGE_DIRS,
    REGISTRATION,
    ROBOT,
    RegistrationEntry,
    RobotEntry,
    read_registration,
)
from app.case.manifest.structures import (
    DIFFERENT,
    IN_LISTS,
    MARGINS_OF_ALL,
    MEASURABLE,
    STRUCTURES,
    TOOL_DISTANCE,
    TOOLS,
    ArmEntry,
    StructureEntry,
    check_own_names,
    margins_of,
    read_arms,
    read_structures,
    read_tool_distance,
    robots_of,
)
from app.files.declared import By, block_of
from app.files.document import Section
from app.files.keys import Block, Boolean, Choice, Integer, Number, Text, Variant
from app.geometry import NS_PER_MS, InputError

MANIFEST_NAME = "case.yaml"
MAX_RATE_HZ = 20_000.0

FILES = (
    "the named files exist, in the folder of this file or of a package or by an absolute path, "
    "have a known format, and a sha256 is that of its file"
)
OWN_BASE_FRAME = "robot.base_frame is the name of no other frame"


@dataclass(frozen=True, slots=True)
class Provenance:
    """Origin of the data; ``kind`` is always stated, never inferred."""

    kind: Annotated[
        Literal["simulated", "recorded"],
        Choice("simulated or recorded data", ("simulated", "recorded")),
    ]
    source: Annotated[str, Text("where the data come from")]
    licence: Annotated[str, Text("licence of the data")]


@dataclass(frozen=True, slots=True)
class RecordingEntry:
    """The recording: a path as written, relative to the case, and its SHA-256 where given.

    ``rate_hz`` is that of a recording without times, None where it has them.
    """

    path: Annotated[
        str,
        Text(
            "a file or folder in one of the formats of docs/formats.md, or a file package://NAME/..."
        ),
    ]
    sha256: Annotated[
        str | None,
        Text(
            "SHA-256 of the file, checked when given",
            optional=True,
            pattern=re.compile(r"[0-9A-Fa-f]{64}"),
            expected="64 hexadecimal digits",
        ),
        By(lambda block: block.text("sha256").lower() if "sha256" in block else None),
    ]
    rate_hz: Annotated[
        float | None,
        Number(
            "rate of a recording without times; expected only there",
            optional=True,
            above=0.0,
            maximum=MAX_RATE_HZ,
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class ClockEntry:
    """Clock offset, tracker = robot + ``offset_robot_to_tracker_ns``, unless to be estimated."""

    offset_robot_to_tracker_ns: Annotated[
        int,
        Number("tracker time minus robot time", optional=True, minimum=-YEAR_MS, maximum=YEAR_MS),
        By(lambda block: 0 if block.boolean("estimate") else _offset_ns(block)),
    ] = 0
    estimate: Annotated[
        bool, Boolean("estimate the offset from the recorded motion", default=False)
    ] = False

    def check(self, block: Section) -> None:
        """Raise `InputError` for an offset beside an estimate."""
        if self.estimate and "offset_robot_to_tracker_ms" in block:
            raise InputError(
                f"{block.place('estimate')} and an offset are given; expected one of them"
            )


def _offset_ns(block: Section) -> int:
    return round(block.number("offset_robot_to_tracker_ms") * NS_PER_MS)


@dataclass(frozen=True, slots=True, eq=False)
class CaseManifest:
    """A ``case.yaml``, or the sections that a ``live.yaml`` shares with it.

    ``file`` is the name of the file, for messages. A live case has no ``recording``.
    ``structures`` are those beside the tumour, and ``arms`` all tools with their robots, in schema
    2; ``tool``, ``robot`` and ``registration`` are then those of one arm, the first or that of
    `for_tool`. ``tool_distance_mm``: up to which another tool is a warning, None without one.
    """

    file: str
    name: str
    provenance: Provenance
    recording: RecordingEntry | None
    clock: ClockEntry
    tool: ToolEntry
    tumor: TumorEntry
    robot: RobotEntry | None
    registration: RegistrationEntry | None
    margins: MarginEntry
    expected: str | None
    plausibility: PlausibilityEntry = field(default_factory=PlausibilityEntry)
    package_dirs: Mapping[str, str] = field(default_factory=dict)
    images: ImagesEntry | None = None
    items: Mapping[str, ItemEntry] = field(default_factory=dict)
    activation: ActivationEntry | None = None
    structures: tuple[StructureEntry, ...] = ()
    arms: tuple[ArmEntry, ...] = ()
    tool_distance_mm: float | None = None

    @property
    def item_models(self) -> list[tuple[str, MeshEntry, str]]:
        """Name, model and frame of each display item that has a model."""
        return [
            (name, entry.model, entry.tip_frame)
            for name, entry in self.items.items()
            if isinstance(entry, RodEntry) and entry.model is not None
        ]

    @property
    def other_arms(self) -> tuple[ArmEntry, ...]:
        """The arms of the other tools than ``tool``."""
        return tuple(arm for arm in self.arms if arm.tool.frame != self.tool.frame)

    @property
    def name_of_tool(self) -> str:
        """The name of ``tool`` where there are several, else empty."""
        if len(self.arms) < 2:
            return ""
        return next(arm.name for arm in self.arms if arm.tool.frame == self.tool.frame)

    def for_tool(self, name: str) -> "CaseManifest":
        """The manifest with this one of its ``arms``; `InputError` for another name."""
        for arm in self.arms:
            if arm.name == name:
                return replace(self, tool=arm.tool, robot=arm.robot, registration=arm.registration)
        names = ", ".join(arm.name for arm in self.arms)
        raise InputError(
            f"{self.file}: tools: none is named {name!r}; "
            f"expected {f'one of {names}' if names else 'schema 2, which has names of tools'}"
        )

    def recorded(self) -> RecordingEntry:
        """The recording; `InputError` for a live case."""
        if self.recording is None:
            raise InputError(f"{self.file}: a live case has no recording")
        return self.recording


KNOWN_OFFSET = Variant(
    "known offset", ("offset_robot_to_tracker_ms",), where={"estimate": {"const": False}}
)
CLOCK = block_of(
    ClockEntry,
    "clock of the robot's joints; by default that of the tracker",
    optional=True,
    variants=(
        KNOWN_OFFSET,
        Variant("estimated offset", ("estimate",), where={"estimate": {"const": True}}),
    ),
)

CASE = Block(
    "a recorded case",
    {
        "schema": Integer("version of the format", 1, 1),
        "name": Text("name of the case, shown in reports"),
        "provenance": block_of(Provenance, "origin of the data"),
        "recording": block_of(RecordingEntry, "the recorded tracking data"),
        "images": IMAGES,
        ENERGY_DEVICE.name: ACTIVATION,
        "clock": CLOCK,
        **PARTS,
        **{each.name: each.key for each in DISPLAY_ITEMS},
        "robot": ROBOT,
        "package_dirs": PACKAGE_DIRS,
        "registration": REGISTRATION,
        "margins": MARGINS,
        "plausibility": PLAUSIBILITY,
        "expected": Text("file of the expected results: expected.yaml", optional=True),
    },
    needs=(("robot", "registration"),),
    rules=(FILES, "tumor.frame is not the frame of the tool", OWN_BASE_FRAME),
)


def with_lists(block: Block) -> Block:
    """Return the block of schema 2 for that of schema 1: lists in the place of single parts."""
    keys = {name: key for name, key in block.keys.items() if name not in IN_LISTS}
    return replace(
        block,
        keys={
            **keys,
            "schema": Integer("version of the format", 2, 2),
            "tools": TOOLS,
            "tool_distance_mm": TOOL_DISTANCE,
            "structures": STRUCTURES,
            "robots": robots_of(block.keys["registration"]),
            "margins": MARGINS_OF_ALL,
        },
        needs=(),
        rules=(FILES, DIFFERENT, MEASURABLE),
    )


CASE_2 = with_lists(CASE)


def load_manifest(folder: Path) -> CaseManifest:
    """Read ``case.yaml`` of ``folder``; `InputError` for the first fault."""
    path = folder / MANIFEST_NAME
    if not path.is_file():
        raise InputError(f"{folder} is not a case: it has no {MANIFEST_NAME}")
    return read_manifest(load_document(path, CASE, CASE_2))


def load_document(path: Path, schema_1: Block, schema_2: Block) -> Section:
    """Load the mapping at ``path`` by the block of its schema; `InputError` for another one."""

    def of_schema(values: object) -> Block:
        schema = values.get("schema", 1) if isinstance(values, dict) else 1
        if type(schema) is not int or schema not in (1, 2):
            raise InputError(f"{path.name}: schema is {reprlib.repr(schema)}; expected 1 or 2")
        return schema_2 if schema == 2 else schema_1

    return Section.load(path, of_schema)


def read_manifest(document: Section, file: str = MANIFEST_NAME) -> CaseManifest:
    """Read the keys that `CASE` and `LIVE` share; `InputError` for the first fault.

    ``file`` is the name of the file, for messages. Without a clock the joints are on that of the
    tracker.
    """
    lists = document.integer("schema") == 2
    parts = _listed(document) if lists else _single(document)
    items = {
        each.name: document.value(each.name) for each in DISPLAY_ITEMS if each.name in document
    }
    structures = (parts["tumor"], *parts["structures"])
    for tool in [arm.tool for arm in parts["arms"]] or [parts["tool"]]:
        check_frames(document, tool, structures)
        check_item_frames(document, items, tool.frame, [each.frame for each in structures])
    if lists:
        check_own_names(document, structures, parts["arms"], list(items.values()))
    parts["name"] = document.text("name")
    parts["provenance"] = document.value("provenance")
    parts["recording"] = document.value("recording") if "recording" in document else None
    parts["clock"] = document.value("clock") or ClockEntry()
    if lists:
        parts["margins"] = margins_of(document.value("margins"), parts["tumor"].margins)
    else:
        parts["registration"] = read_registration(document, parts["robot"])
        parts["margins"] = document.value("margins")
    return CaseManifest(
        file=file,
        **parts,
        items=items,
        expected=document.text("expected") if "expected" in document else None,
        plausibility=document.value("plausibility") or PlausibilityEntry(),
        package_dirs=document.value("package_dirs") or {},
        images=read_images(document),
        activation=read_activation(document),
    )


def _single(document: Section) -> dict[str, Any]:
    parts = {key: document.value(key) for key in ("robot", "tool", "tumor")}
    return {**parts, "structures": (), "arms": ()}


def _listed(document: Section) -> dict[str, Any]:
    arms = read_arms(document)
    tumor, *structures = read_structures(document)
    first = arms[0]
    return {
        "robot": first.robot,
        "tool": first.tool,
        "tumor": tumor,
        "registration": first.registration,
        "structures": tuple(structures),
        "arms": arms,
        "tool_distance_mm": read_tool_distance(document, arms),
    }
