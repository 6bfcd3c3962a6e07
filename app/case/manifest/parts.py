"""Tool and tumour, the same in ``case.yaml`` and in ``live.yaml``."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from app.case.manifest.key_rules import (
    pose_block,
    read_pose,
)
from app.case.tumor import SEGMENTATION_ENDING
from app.files.declared import By, block_of
from app.files.document import Section
from app.files.keys import Block, Boolean, Choice, Frame, Number, Text, Variant
from app.files.meshes import MESH_PATH, MESH_UNITS, UNITS_MM
from app.geometry import InputError, Transform

TUMOR_MESH_FRAME = "tumor"


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


def read_tip(block: Section) -> Transform:
    """Read ``tip_from`` as the pose of the tip in ``frame``."""
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
        Transform, "tip_from", pose_block("pose of the tip in the tracked frame"), By(read_tip)
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


PARTS = {
    "tool": block_of(ToolEntry, "the tracked tool"),
    "tumor": block_of(
        TumorEntry,
        "the tumour",
        variants=(Variant("mesh or segmentation", ("mesh",)), Variant("contour", ("contour",))),
    ),
}


def check_frames(document: Section, tool: ToolEntry, structures: Sequence[TumorEntry]) -> None:
    """Raise `InputError` for a structure in the frame of the tool."""
    found = next((each for each in structures if each.frame == tool.frame), None)
    if found is not None:
        raise InputError(
            f"{document.place(found.key)}.frame is {found.frame!r}, the frame of the tool; "
            "expected a frame that does not move with the tool"
        )
