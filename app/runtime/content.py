"""Content of a session: structures, tool, robot, static transforms, registration, margins."""

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.case import Case, MarginEntry, RegistrationValues, SessionValues, StructureValues
from app.fixture import FIXTURE_FRAME, MarginParameters
from app.geometry import FrameError, InputError, SurfaceMesh, Transform
from app.registration import RegistrationResult
from app.robot import urdf_text
from app.runtime.display_items import ImageDepth, ShownItem, image_depth_of, items_of
from app.session import RobotSetup, Role, SessionSetup
from app.session.structure import with_named


@dataclass(frozen=True, slots=True, eq=False)
class StructureContent:
    """A structure beside the tumour, whose surface is in the frame of its name."""

    surface: SurfaceMesh
    role: Role
    stop_mm: float
    warn_mm: float
    sigma_mm: float = 0.0

    @property
    def name(self) -> str:
        """Its name."""
        return self.surface.frame


@dataclass(frozen=True, slots=True, eq=False)
class ToolContent:
    """Another tool, whose surface is in the frame of its tip."""

    name: str
    surface: SurfaceMesh
    tool_from_tip: Transform


@dataclass(frozen=True, slots=True, eq=False)
class SessionContent:
    """The one description of a session that publishers, scene, viewer, report and panel take.

    It does not change; an operator's command replaces it as a whole, so two contents are the same
    when they are one object. It holds plain values and can be sent to another process.

    ``tumor`` is in the frame ``tumor.frame``; ``tool`` in ``tip_frame``, or None where only the
    tip is known. ``static_edges`` are the calibrations and the registration, each child frame
    once. ``tumor_sigma_mm``: standard deviation of the tumour's surface, ``tip_sigma_mm`` that of
    the calibrated tip; 0 where they are not stated. ``robot`` is None for a tool that is held by
    hand. ``robot_file`` with ``package_dirs`` and ``xacro_args`` is where the robot's description
    is read from. ``simulated``: the poses are not a patient's. ``tumor_accepted``: an operator has
    accepted the tumour in this session. ``items`` are the display items, ``image_depth`` is None
    for a session without several depths of its images: no decision depends on them.
    ``structures`` are guarded beside the tumour.
    ``tool_name`` is that of one of several tools, each of which has a session; else empty.
    ``tools`` are the others that have a mesh; their tips are no ``static_edges``.
    """

    name: str
    tumor: SurfaceMesh
    tool: SurfaceMesh | None
    tip_frame: str
    static_edges: tuple[Transform, ...]
    margins: MarginParameters
    robot: RobotSetup | None = None
    robot_file: Path | None = None
    package_dirs: tuple[Path, ...] = ()
    xacro_args: Mapping[str, str] = field(default_factory=dict)
    simulated: bool = False
    tumor_sigma_mm: float = 0.0
    tip_sigma_mm: float = 0.0
    tumor_accepted: bool = False
    items: tuple[ShownItem, ...] = ()
    image_depth: ImageDepth | None = None
    structures: tuple[StructureContent, ...] = ()
    tool_name: str = ""
    tools: tuple[ToolContent, ...] = ()

    def __post_init__(self) -> None:
        tips = (tool.tool_from_tip for tool in self.tools)
        children = [edge.source for edge in (*self.tf_static_edges, *tips)]
        for child in children:
            if children.count(child) > 1:
                raise FrameError(
                    f"static transforms: frame {child!r} has {children.count(child)} parents; "
                    "expected 1"
                )

    @property
    def fixture_frame(self) -> str:
        """Name of the frame of the governing plane on tf, its own for each of several tools."""
        return f"{FIXTURE_FRAME}_{self.tool_name}" if self.tool_name else FIXTURE_FRAME

    @property
    def registration(self) -> RegistrationResult | None:
        """The registration of the robot's base, None without a robot or before it is registered."""
        return None if self.robot is None else self.robot.registration

    @property
    def tf_static_edges(self) -> tuple[Transform, ...]:
        """``static_edges`` and, where their names differ, the edge from base to root link."""
        if self.robot is None or self.robot.base_frame == self.robot.robot.root_link:
            return self.static_edges
        root = Transform.identity(self.robot.base_frame, self.robot.robot.root_link)
        return (*self.static_edges, root)

    @property
    def tool_from_tip(self) -> Transform:
        """The tip in the tool's tracked frame. Raises `FrameError` if no edge places it."""
        return self.static_edge(self.tip_frame)

    def static_edge(self, frame: str) -> Transform:
        """The static transform that places ``frame``; raises `FrameError` if there is none."""
        for edge in self.static_edges:
            if edge.source == frame:
                return edge
        raise FrameError(f"static transforms: none places {frame!r}; expected one")

    def item(self, name: str) -> ShownItem:
        """The display item ``name``. Raises `InputError` without it."""
        for each in self.items:
            if each.name == name:
                return each
        raise InputError(f"{name}: the session has none; expected {name!r} in live.yaml")

    def with_structure(
        self, structure: StructureContent, frame_from_structure: Transform
    ) -> "SessionContent":
        """This content with ``structure`` for that of the same name, or as the last one."""
        structures = with_named(self.structures, structure)
        return self.with_edge(frame_from_structure, structures=structures)

    def without_structure(self, name: str) -> "SessionContent":
        """This content without the structure ``name`` and its pose."""
        return replace(
            self,
            static_edges=tuple(each for each in self.static_edges if each.source != name),
            structures=tuple(each for each in self.structures if each.name != name),
        )

    def structure(self, name: str) -> StructureContent | None:
        """The structure ``name`` beside the tumour; None without it."""
        return next((each for each in self.structures if each.name == name), None)

    @property
    def structure_surfaces(self) -> dict[str, SurfaceMesh]:
        """Surfaces of the structures beside the tumour by name."""
        return {each.name: each.surface for each in self.structures}

    @property
    def surfaces(self) -> dict[str, SurfaceMesh]:
        """Surfaces of the tumour and the structures by their frames."""
        return {self.tumor.frame: self.tumor} | self.structure_surfaces

    def with_margins(self, setup: SessionSetup) -> "SessionContent":
        """This content with the margins of ``setup`` and the distances of its structures."""
        used = {each.name: (each.stop_mm, each.warn_mm) for each in setup.structures}
        structures = tuple(
            each
            if used.get(each.name) in (None, (each.stop_mm, each.warn_mm))
            else replace(each, stop_mm=used[each.name][0], warn_mm=used[each.name][1])
            for each in self.structures
        )
        return replace(self, margins=setup.margins, structures=structures)

    def with_item(self, item: ShownItem) -> "SessionContent":
        """This content with ``item`` for that of the same name."""
        items = (item if each.name == item.name else each for each in self.items)
        return replace(self, items=tuple(items))

    @property
    def model_id(self) -> str:
        """Digest of the tumour's surface: changes with any of its numbers."""
        return surface_digest(self.tumor)

    @property
    def registration_id(self) -> str:
        """Digest of the registration, empty without one."""
        registration = self.registration
        return "" if registration is None else _digest(registration.transform.matrix)

    @property
    def setup_id(self) -> str:
        """Digest that changes with the structures, their poses and the registration."""
        numbers = [self.model_id, self.registration_id, _digest(self.frame_from_tumor.matrix)]
        for each in self.structures:
            pose = self.static_edge(each.name)
            numbers += [surface_digest(each.surface), _digest(pose.matrix)]
        return hashlib.sha256("/".join(numbers).encode()).hexdigest()[:16]

    @property
    def frame_from_tumor(self) -> Transform:
        """The tumour in the tracked frame that it moves with. Raises `FrameError` without one."""
        return self.static_edge(self.tumor.frame)

    def replaced_since(self, before: "SessionContent") -> tuple[str, ...]:
        """Names of the changed ones of the parts that an operator can replace."""
        if self is before:
            return ()
        tumors = [(c.model_id, c.frame_from_tumor, c.tumor_sigma_mm) for c in (self, before)]
        tips = [(c.tool_from_tip, c.tip_sigma_mm) for c in (self, before)]
        parts = {
            "tumour": tumors[0] != tumors[1],
            "registration": self.registration is not before.registration,
            "tip": tips[0] != tips[1],
            "margins": self.margins != before.margins,
            "structures": self.structures != before.structures,
            **{each.name: each not in before.items for each in self.items},
        }
        return tuple(name for name, differs in parts.items() if differs)

    def unpublished_changes(self, before: "SessionContent") -> tuple[str, ...]:
        """Those of `replaced_since` that the ids of published constraints do not show."""
        shown = {
            "tumour": self.model_id != before.model_id,
            "registration": self.registration_id != before.registration_id,
        }
        return tuple(part for part in self.replaced_since(before) if not shown.get(part))

    def values(self, initial: "SessionContent") -> SessionValues:
        """Values that a recording must contain of a session that began with ``initial``."""
        registration = self.registration
        return SessionValues(
            tool_from_tip=self.tool_from_tip,
            tip_sigma_mm=self.tip_sigma_mm,
            frame_from_tumor=self.frame_from_tumor,
            tumor_sigma_mm=self.tumor_sigma_mm,
            margins=MarginEntry(**asdict(self.margins)),
            tumor=None if self.model_id == initial.model_id else self.tumor,
            registration=None
            if registration is None or registration is initial.registration
            else RegistrationValues(
                registration.transform,
                registration.covariance,
                registration.degrees_of_freedom,
            ),
            items={each.name: each.keys for each in self.items},
            image_depth_mm=None if self.image_depth is None else self.image_depth.depth_mm,
            structures=None
            if self.structures == initial.structures
            else tuple(
                StructureValues(
                    each.surface,
                    self.static_edge(each.name),
                    *(each.role, each.stop_mm, each.warn_mm, each.sigma_mm),
                )
                for each in self.structures
            ),
        )

    def setup(self, base: SessionSetup) -> SessionSetup:
        """``base`` with the poses, the robot and the uncertainties of this content.

        The margins stay those of ``base``: a content has those in use, not looser ones that wait
        for a re-arm.
        """
        return replace(
            base,
            tool_from_tip=self.tool_from_tip,
            frame_from_tumor=self.frame_from_tumor,
            robot=self.robot,
            tumor_sigma_mm=self.tumor_sigma_mm,
            tip_sigma_mm=self.tip_sigma_mm,
        )

    def with_edge(self, edge: Transform, **changes: Any) -> "SessionContent":
        """This content with ``edge`` for that of the same child frame, and with ``changes``."""
        others = (each for each in self.static_edges if each.source != edge.source)
        return replace(self, static_edges=(*others, edge), **changes)

    def robot_description(self) -> str | None:
        """Read the robot's URDF; None without a robot. Raises `UrdfError` for a broken file."""
        if self.robot_file is None:
            return None
        return urdf_text(
            self.robot_file, package_dirs=self.package_dirs, xacro_args=self.xacro_args
        )


def content_of(case: Case, setup: SessionSetup, *, tip_only: bool) -> SessionContent:
    """Describe the session of ``case`` that ``setup`` starts with."""
    meshes = case.other_tool_meshes()
    return SessionContent(
        name=case.manifest.name,
        tumor=case.tumor_mesh(),
        tool=None if tip_only else case.tool_mesh(),
        tip_frame=setup.tool_from_tip.source,
        static_edges=setup.static_edges,
        margins=setup.margins,
        robot=setup.robot,
        robot_file=None if setup.robot is None else case.robot_urdf(),
        package_dirs=case.package_dirs,
        xacro_args={} if case.manifest.robot is None else case.manifest.robot.xacro_args,
        simulated=case.manifest.provenance.kind == "simulated",
        tumor_sigma_mm=setup.tumor_sigma_mm,
        tip_sigma_mm=setup.tip_sigma_mm,
        items=items_of(case),
        image_depth=image_depth_of(case),
        structures=tuple(
            StructureContent(
                case.structure_mesh(entry), each.role, each.stop_mm, each.warn_mm, each.sigma_mm
            )
            for entry, each in zip(case.manifest.structures, setup.structures, strict=True)
        ),
        tool_name=case.manifest.name_of_tool,
        tools=tuple(
            ToolContent(arm.name, meshes[arm.name], arm.tool.tool_from_tip)
            for arm in case.manifest.other_arms
            if arm.name in meshes
        ),
    )


@lru_cache(maxsize=8)  # a large surface takes milliseconds, and each constraint has its digest
def surface_digest(surface: SurfaceMesh) -> str:
    """Changes with any of the numbers of ``surface``."""
    return _digest(surface.vertices_mm, surface.faces)


def _digest(*arrays: NDArray[Any]) -> str:
    """Digest of the bytes of ``arrays``; releases the GIL for large ones."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).data)
    return f"sha256:{digest.hexdigest()[:16]}"
