"""Tool, tumour, needle and stylus, the same in ``case.yaml`` and in ``live.yaml``."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from app.case.manifest.key_rules import (
    NO_DIRECTION,
    REFERENCE_FRAME,
    Triple,
    pose_block,
    read_direction,
    read_pose,
)
from app.case.tumor import SEGMENTATION_ENDING
from app.files.declared import By, block_of
from app.files.document import Section
from app.files.keys import Block, Boolean, Choice, Frame, Number, Numbers, Text, Variant
from app.files.meshes import MESH_PATH, MESH_UNITS, UNITS_MM
from app.geometry import InputError, Transform

TUMOR_MESH_FRAME = "tumor"

MIN_NEEDLE_MM, MAX_NEEDLE_MM = 1.0, 500.0
"""Lengths of a needle, in its file and as an operator sets it."""

MAX_STYLUS_SIGMA_MM = 10.0
"""Largest uncertainty of the tip of a stylus."""

MIN_STYLUS_MM = 1.0
"""A tip closer to the sensor's origin was never calibrated."""

NOT_THE_TOOL = "needle.frame is not the frame of the tool"
OWN_STYLUS_FRAME = "stylus.frame is not reference, and not the frame of tool, tumour or needle"
STYLUS_TIP = "stylus.tip_from is 1 mm or more from the sensor's origin"


@dataclass(frozen=True, slots=True)
class MeshEntry:
    """Path of a mesh file as written, and the unit of its coordinates.

    ``repair``: whether its faults are repaired where that is safe; otherwise they are refused.
    """

    path: Annotated[str, Text(MESH_PATH)]
    units: Annotated[str, MESH_UNITS]
    repair: Annotated[
        bool,
        Boolean(
            "repair faults of the mesh where that is safe, unite overlapping parts", default=False
        ),
    ] = False


@dataclass(frozen=True, slots=True)
class SegmentationEntry:
    """Path of a label map as written, and its segment; None where it holds only one."""

    path: str
    segment: str | None


@dataclass(frozen=True, slots=True)
class ContourEntry:
    """Path, as written, of a file of points on the tumour's surface."""

    path: Annotated[
        str, Text(".mrk.json, .fcsv or .yaml, relative, absolute or package://NAME/...")
    ]


def _tip(block: Section) -> Transform:
    frame = block.frame("frame")
    return read_pose(block, "tip_from", target=frame, source=f"{frame}_tip")


@dataclass(frozen=True, slots=True, eq=False)
class ToolEntry:
    """The tracked tool. The mesh is in the tip's frame; without one only the tip is replayed.

    ``sigma_mm``: standard deviation of the tip in its worst direction, 0 where it is not stated.
    """

    frame: Annotated[str, Frame("the tracked frame")]
    mesh: Annotated[
        MeshEntry | None,
        block_of(
            MeshEntry,
            "closed surface in the frame of the tip; only a replay with --tip-only needs none",
            optional=True,
        ),
    ]
    tool_from_tip: Annotated[
        Transform, "tip_from", pose_block("pose of the tip in the tracked frame"), By(_tip)
    ]
    sigma_mm: Annotated[
        float,
        Number(
            "standard deviation of the tip in its worst direction, added to that of the "
            "registration",
            default=0.0,
            minimum=0.0,
            maximum=10.0,
        ),
    ] = 0.0

    @property
    def tip_frame(self) -> str:
        """The frame of the tip and of the mesh."""
        return self.tool_from_tip.source


_SEGMENTATION = "".join(
    f"[{letter}{letter.upper()}]" if letter.isalpha() else re.escape(letter)
    for letter in SEGMENTATION_ENDING
)
_IS_SEGMENTATION = {"type": "string", "pattern": rf"{_SEGMENTATION}$(?!\n)"}


def _tumor_mesh(mesh: Section) -> MeshEntry | SegmentationEntry:
    path = mesh.text("path")
    if not path.lower().endswith(SEGMENTATION_ENDING):
        if "segment" in mesh:
            raise InputError(f"{mesh.place('segment')} is given, but {path} is not a segmentation")
        return MeshEntry(path, mesh.choice("units"), "repair" in mesh and mesh.boolean("repair"))
    if "repair" in mesh:
        raise InputError(
            f"{mesh.place('repair')} is given for a segmentation; only mesh files are repaired"
        )
    if "units" in mesh:
        raise InputError(
            f"{mesh.place('units')} is given for a segmentation; its unit is always mm"
        )
    return SegmentationEntry(path, mesh.text("segment") if "segment" in mesh else None)


_TUMOR_SHAPE = {
    "mesh": Block(
        "a mesh file with units, or a segmentation",
        {
            "path": Text(f"{MESH_PATH}, or a segmentation ({SEGMENTATION_ENDING})"),
            "units": Choice("unit of the mesh file's coordinates", tuple(UNITS_MM), optional=True),
            "repair": Boolean(
                "repair faults of the mesh where that is safe; default false", optional=True
            ),
            "segment": Text(
                "name, ID or label value of the segment; needed if there are several", optional=True
            ),
        },
        optional=True,
        variants=(
            Variant("mesh file", ("units",), ("repair",), {"path": {"not": _IS_SEGMENTATION}}),
            Variant("segmentation", optional=("segment",), where={"path": _IS_SEGMENTATION}),
        ),
        read=_tumor_mesh,
    ),
    "contour": block_of(
        ContourEntry,
        "points on the tumour's surface; the tumour is their convex hull, rounded outward",
        optional=True,
    ),
}


def _shape(tumor: Section) -> MeshEntry | SegmentationEntry | ContourEntry:
    if "contour" in tumor and "mesh" in tumor:
        raise InputError(f"{tumor.place('mesh')} and a contour are given; expected one of them")
    return tumor.value("contour") or _tumor_mesh(tumor.section("mesh"))


def _tumor_pose(tumor: Section) -> Transform:
    return read_pose(tumor, "pose", target=tumor.frame("frame"), source=TUMOR_MESH_FRAME)


@dataclass(frozen=True, slots=True, eq=False)
class TumorEntry:
    """The tumour's shape, rigidly attached to the tracked ``frame``.

    ``sigma_mm``: standard deviation of its surface along the normal, 0 where it is not stated.
    """

    frame: Annotated[str, Frame("the tracked frame that the tumour moves with")]
    shape: Annotated[MeshEntry | SegmentationEntry | ContourEntry, _TUMOR_SHAPE, By(_shape)]
    frame_from_tumor: Annotated[
        Transform,
        "pose",
        pose_block("pose of the tumour's coordinates in its frame"),
        By(_tumor_pose),
    ]
    sigma_mm: Annotated[
        float,
        Number(
            "standard deviation of the surface along its normal, added to that of the registration",
            default=0.0,
            minimum=0.0,
            maximum=10.0,
        ),
    ] = 0.0

    @property
    def key(self) -> str:
        """The manifest's key of the structure, for messages."""
        return "tumor"

    @property
    def shape_key(self) -> str:
        """The manifest's key of the shape, for messages."""
        return f"{self.key}.{'contour' if isinstance(self.shape, ContourEntry) else 'mesh'}"


@dataclass(frozen=True, slots=True)
class NeedleEntry:
    """A needle that is shown: its tip is ``length_mm`` along ``direction`` from its sensor.

    ``frame`` is the tracked frame of the sensor, ``direction`` a unit vector in it. ``model`` is
    in the frame of the tip; None for a generated one. No distance depends on it.
    """

    frame: Annotated[str, Frame("the tracked frame of its sensor, often that of the tumour")]
    length_mm: Annotated[
        float,
        Number("from the sensor to the tip", minimum=MIN_NEEDLE_MM, maximum=MAX_NEEDLE_MM),
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
        By(lambda needle: needle.value("tip_from") or (0.0, 0.0, 1.0)),
    ]
    model: Annotated[
        MeshEntry | None,
        Block(
            "surface in the frame of the tip, the tip at 0 and +z forward; by default a thin "
            "needle of that length",
            {
                "path": Text("mesh file (.stl, .ply, .obj), relative, absolute or package://..."),
                "units": MESH_UNITS,
            },
            optional=True,
            read=lambda model: MeshEntry(model.text("path"), model.choice("units")),
        ),
    ]

    @property
    def tip_frame(self) -> str:
        """The frame of the tip and of the model."""
        return f"{self.frame}_tip"


@dataclass(frozen=True, slots=True, eq=False)
class StylusEntry:
    """A tracked stylus with which an operator touches points. No distance depends on it.

    ``frame`` is the tracked frame of its sensor, ``frame_from_tip`` its tip with +z forward, None
    before a calibration. ``sigma_mm``: standard deviation of the tip in its worst direction, 0
    where it is not stated.
    """

    frame: Annotated[str, Frame("the tracked frame of its sensor")]
    frame_from_tip: Annotated[
        Transform | None,
        "tip_from",
        pose_block(
            "pose of the tip in the tracked frame, +z forward; without it the stylus has to be "
            "calibrated before it can be used",
            optional=True,
        ),
        By(lambda stylus: _tip(stylus) if "tip_from" in stylus else None),
    ]
    sigma_mm: Annotated[
        float,
        Number(
            "standard deviation of the tip in its worst direction",
            default=0.0,
            minimum=0.0,
            maximum=MAX_STYLUS_SIGMA_MM,
        ),
    ] = 0.0

    def check(self, block: Section) -> None:
        """Raise `InputError` for a tip at its sensor's origin."""
        if self.frame_from_tip is None:
            return
        length_mm = float(np.linalg.norm(self.frame_from_tip.translation_mm))
        if length_mm < MIN_STYLUS_MM:
            raise InputError(
                f"{block.place('tip_from')} is {length_mm:.3g} mm from the sensor's origin; "
                f"expected {MIN_STYLUS_MM:g} mm or more, or no tip_from before a calibration"
            )


PARTS = {
    "tool": block_of(ToolEntry, "the tracked tool"),
    "tumor": block_of(
        TumorEntry,
        "the tumour",
        variants=(Variant("mesh or segmentation", ("mesh",)), Variant("contour", ("contour",))),
    ),
    "needle": block_of(
        NeedleEntry,
        "the tracked needle, which is shown and nothing else: no distance depends on it",
        optional=True,
        rules=(NOT_THE_TOOL,),
    ),
    "stylus": block_of(
        StylusEntry,
        "a tracked stylus, with which an operator touches points: no distance depends on it",
        optional=True,
        rules=(OWN_STYLUS_FRAME, STYLUS_TIP),
    ),
}


def check_frames(
    document: Section,
    tool: ToolEntry,
    structures: Mapping[str, TumorEntry],
    needle: NeedleEntry | None,
    stylus: StylusEntry | None,
) -> None:
    """Raise `InputError` unless the frames differ; needle and ``structures`` may share theirs.

    ``structures`` are given by their places in the document.
    """
    taken = {tool.frame: "the frame of the tool"}
    for place, structure in structures.items():
        if structure.frame in taken:
            raise InputError(
                f"{place}.frame is {structure.frame!r}, the frame of the tool; "
                "expected a frame that does not move with the tool"
            )
    if needle is not None and needle.frame in taken:
        raise InputError(
            f"{document.place('needle')}.frame is {needle.frame!r}, the frame of the tool; "
            "expected that of a sensor on the needle"
        )
    taken |= {each.frame: "the frame of the tumour" for each in structures.values()}
    taken[REFERENCE_FRAME] = "the reference"
    if needle is not None:
        taken[needle.frame] = "the frame of the needle"
    if stylus is not None and stylus.frame in taken:
        raise InputError(
            f"{document.place('stylus')}.frame is {stylus.frame!r}, {taken[stylus.frame]}; "
            "expected that of a sensor on the stylus"
        )
