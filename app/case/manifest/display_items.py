"""Display items, all declared here: tracked and shown, but no decision depends on them.

From a declaration follow its key in ``case.yaml`` and ``live.yaml``, the item of a session's
content, the operator's command that changes it, its model in the scene, and its rows on page and
panel. To add one, declare it in `DISPLAY_ITEMS`.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Annotated

import numpy as np

from app.case.manifest.key_rules import (
    NO_DIRECTION,
    REFERENCE_FRAME,
    Triple,
    pose_block,
    read_direction,
)
from app.case.manifest.parts import MeshEntry, read_tip
from app.files.declared import By, block_of
from app.files.document import Section
from app.files.keys import Block, Frame, Number, Numbers, Text
from app.files.meshes import MESH_PATH, MESH_UNITS
from app.geometry import InputError, Transform


class ItemKind(Enum):
    """The way in which the tip of an item is known, and what is shown without a usable pose."""

    ROD = "rod"
    """Its tip is at a length that an operator can change. It is grey without a pose."""
    POINTER = "pointer"
    """An operator calibrates its tip and touches points with it. It is hidden without a pose."""


@dataclass(frozen=True, slots=True)
class DisplayItem:
    """Declaration of one item.

    ``name`` is its key in ``case.yaml``, ``title`` its name for people, ``color`` red, green and
    blue from 0 to 1. It is drawn as a rod of ``radius_mm``, at most ``drawn_mm`` long, whose last
    ``point_mm`` are a cone.
    """

    name: str
    kind: ItemKind
    title: str
    description: str
    color: tuple[float, float, float]
    radius_mm: float
    point_mm: float
    drawn_mm: float = np.inf

    @property
    def heading(self) -> str:
        """Heading of its row on page and panel."""
        return f"{self.title} length, mm" if self.kind is ItemKind.ROD else self.title

    @property
    def model_name(self) -> str:
        """Name of its node in the scene."""
        return f"{self.title}Model"

    @property
    def command(self) -> str:
        """Kind of the operator's request that changes its tip."""
        is_rod = self.kind is ItemKind.ROD
        return f"{self.name}_length" if is_rod else f"set_{self.name}_tip"

    @property
    def rules(self) -> tuple[str, ...]:
        """The rules of its keys that concern other keys."""
        if self.kind is ItemKind.ROD:
            return (f"{self.name}.frame is not the frame of the tool",)
        rods = (each.name for each in DISPLAY_ITEMS if each.kind is ItemKind.ROD)
        *first, last = "tool", "tumour", *rods
        others = f"{', '.join(first)} or {last}"
        return (
            f"{self.name}.frame is not reference, and not the frame of {others}",
            f"{self.name}.tip_from is 1 mm or more from the sensor's origin",
        )

    @property
    def key(self) -> Block:
        """Its key in ``case.yaml`` and ``live.yaml``."""
        entry = RodEntry if self.kind is ItemKind.ROD else PointerEntry
        return block_of(entry, self.description, optional=True, rules=self.rules)


@dataclass(frozen=True, slots=True)
class EnergyDevice:
    """A device whose activation is shown and recorded, and changes no margin.

    ``name`` is its key in ``case.yaml``, ``title`` its name for people; ``burns`` says in words
    that it is active.
    """

    name: str
    title: str
    burns: str


ENERGY_DEVICE = EnergyDevice("cautery", "Cautery", "the cautery burns")

DISPLAY_ITEMS = (
    DisplayItem(
        "needle",
        ItemKind.ROD,
        "Needle",
        "the tracked needle, which is shown and nothing else: no distance depends on it",
        color=(0.33, 1.0, 1.0),  # that of LumpNav
        radius_mm=0.75,
        point_mm=4.0,
    ),
    DisplayItem(
        "stylus",
        ItemKind.POINTER,
        "Stylus",
        "a tracked stylus, with which an operator touches points: no distance depends on it",
        color=(1.0, 0.55, 0.85),
        radius_mm=2.0,
        point_mm=15.0,
        drawn_mm=150.0,
    ),
)
"""All of them, in their order on page and panel."""

MIN_ROD_MM, MAX_ROD_MM = 1.0, 500.0
"""Lengths of a rod, in its file and as an operator sets it."""

MAX_POINTER_SIGMA_MM = 10.0
"""Largest uncertainty of the tip of a pointer."""

MIN_POINTER_MM = 1.0
"""A tip closer to the sensor's origin was never calibrated."""


@dataclass(frozen=True, slots=True)
class RodEntry:
    """A rod: its tip is ``length_mm`` along ``direction`` from its sensor.

    ``frame`` is the tracked frame of the sensor, ``direction`` a unit vector in it. ``model`` is
    in the frame of the tip; None for a generated one.
    """

    frame: Annotated[str, Frame("the tracked frame of its sensor, often that of the tumour")]
    length_mm: Annotated[
        float,
        Number("from the sensor to the tip", minimum=MIN_ROD_MM, maximum=MAX_ROD_MM),
    ]
    direction: Annotated[
        Triple,
        "tip_from",
        Block(
            "where the tip is, seen from the sensor; by default along its z axis",
            {"direction": Numbers("direction from the sensor to the tip: 3 numbers", 3)},
            optional=True,
            rules=(NO_DIRECTION,),
            read=lambda block: read_direction(block, "direction"),
        ),
        By(lambda rod: rod.value("tip_from") or (0.0, 0.0, 1.0)),
    ]
    model: Annotated[
        MeshEntry | None,
        Block(
            "surface in the frame of the tip, the tip at 0 and +z forward; by default a thin rod "
            "of that length",
            {"path": Text(MESH_PATH), "units": MESH_UNITS},
            optional=True,
            read=lambda model: MeshEntry(model.text("path"), model.choice("units")),
        ),
    ]

    @property
    def tip_frame(self) -> str:
        """The frame of the tip and of the model."""
        return f"{self.frame}_tip"


@dataclass(frozen=True, slots=True, eq=False)
class PointerEntry:
    """A pointer with which an operator touches points.

    ``frame`` is the tracked frame of its sensor, ``frame_from_tip`` its tip with +z forward, None
    before a calibration. ``sigma_mm``: standard deviation of the tip in its worst direction, 0
    where it is not stated.
    """

    frame: Annotated[str, Frame("the tracked frame of its sensor")]
    frame_from_tip: Annotated[
        Transform | None,
        "tip_from",
        pose_block(
            "pose of the tip in the tracked frame, +z forward; without it the tip has to be "
            "calibrated before it can be used",
            optional=True,
        ),
        By(lambda pointer: read_tip(pointer) if "tip_from" in pointer else None),
    ]
    sigma_mm: Annotated[
        float,
        Number(
            "standard deviation of the tip in its worst direction",
            default=0.0,
            minimum=0.0,
            maximum=MAX_POINTER_SIGMA_MM,
        ),
    ] = 0.0

    def check(self, block: Section) -> None:
        """Raise `InputError` for a tip at its sensor's origin."""
        if self.frame_from_tip is None:
            return
        length_mm = float(np.linalg.norm(self.frame_from_tip.translation_mm))
        if length_mm < MIN_POINTER_MM:
            raise InputError(
                f"{block.place('tip_from')} is {length_mm:.3g} mm from the sensor's origin; "
                f"expected {MIN_POINTER_MM:g} mm or more, or no tip_from before a calibration"
            )


ItemEntry = RodEntry | PointerEntry


def check_item_frames(
    document: Section, items: Mapping[str, ItemEntry], tool: str, structures: Collection[str]
) -> None:
    """Raise `InputError` for a frame of another part. A rod and a structure may share theirs.

    ``tool`` and ``structures`` are their frames.
    """
    taken = {tool: "the frame of the tool"}
    for kind in ItemKind:
        for item in DISPLAY_ITEMS:
            entry = items.get(item.name)
            if entry is None or item.kind is not kind:
                continue
            if entry.frame in taken:
                raise InputError(
                    f"{document.place(item.name)}.frame is {entry.frame!r}, "
                    f"{taken[entry.frame]}; expected that of a sensor on the {item.name}"
                )
            taken[entry.frame] = f"the frame of the {item.name}"
        tumors = dict.fromkeys(structures, "the frame of the tumour")
        taken = {**tumors, REFERENCE_FRAME: "the reference", **taken}
