"""Setup of a session from a case, and distance engines for many cases with one tool."""

from collections.abc import Callable
from dataclasses import asdict, replace

import numpy as np

from app.case import Case
from app.fixture import MarginParameters, ProximityEngine, TipProximity
from app.fixture.proximity.engine import prepared_tumor
from app.geometry import SurfaceMesh
from app.registration import DriftBound
from app.session.case_preparation import load_case_robot, register_robot
from app.session.named_frames import check_frames
from app.session.setup import OtherTool, RobotSetup, SessionSetup
from app.session.structure import ProximityModel, Role, Structure

MakeEngine = Callable[[SurfaceMesh, SurfaceMesh], ProximityEngine]


def setup_from_case(
    case: Case, *, tip_only: bool = False, make_engine: MakeEngine = ProximityEngine
) -> SessionSetup:
    """Setup of a session for ``case``; with ``tip_only`` the tool is reduced to its tip.

    ``make_engine`` makes the engine of the whole tool from the meshes of tumour and tool.
    Reads the recording up to its last landmark dwell if the registration needs it. Raises
    `FrameError` for a recording that does not connect the tool to the tumour.
    """
    check_frames(case)
    manifest = case.manifest
    limit_mm = manifest.tool_distance_mm
    if manifest.other_arms:
        note = f"tools: {len(manifest.arms)} are given; only {manifest.tool.frame!r} is guarded"
        if limit_mm is None:
            note += "; the distance between them is not checked without tool_distance_mm"
        case.add_notes([note])
    margins = margin_parameters(case)
    tumor = case.tumor_mesh()
    tool = None if tip_only else case.tool_mesh()

    def model(structure: SurfaceMesh) -> ProximityModel:
        return TipProximity(structure) if tool is None else make_engine(structure, tool)

    proximity = model(tumor)
    others = {} if limit_mm is None else case.other_tool_meshes()
    return SessionSetup(
        tool_from_tip=manifest.tool.tool_from_tip,
        frame_from_tumor=manifest.tumor.frame_from_tumor,
        proximity=proximity,
        margins=margins,
        robot=_robot_setup(case, margins),
        plausibility=manifest.plausibility,
        tumor_sigma_mm=manifest.tumor.sigma_mm,
        tip_sigma_mm=manifest.tool.sigma_mm,
        shown_frames=tuple(
            each.frame
            for each in (*manifest.items.values(), *(arm.tool for arm in manifest.other_arms))
        ),
        structures=tuple(
            Structure(
                each.frame_from_tumor,
                model(case.structure_mesh(each)),
                each.margins.stop_mm,
                each.margins.warn_mm,
                each.sigma_mm,
                Role(each.role),
            )
            for each in manifest.structures
        ),
        other_tools=tuple(
            OtherTool(arm.name, arm.tool.tool_from_tip, model(others[arm.name]), limit_mm)
            for arm in manifest.other_arms
            if limit_mm is not None
        ),
        tool_names=tuple(arm.name for arm in manifest.other_arms),
    )


def robot_from_case(case: Case) -> RobotSetup | None:
    """The registered robot of ``case``; the recording need not contain the tumour's frame.

    None for a case without a robot. Reads the recording as `setup_from_case` does.
    """
    check_frames(case, with_tumor=False)
    return _robot_setup(case, margin_parameters(case))


def margin_parameters(case: Case) -> MarginParameters:
    """The manifest's margins as checked `MarginParameters`."""
    return MarginParameters(**asdict(case.manifest.margins))


def _robot_setup(case: Case, margins: MarginParameters) -> RobotSetup | None:
    robot, registration = case.manifest.robot, case.manifest.registration
    if robot is None or registration is None:
        return None
    unregistered = RobotSetup(
        robot=load_case_robot(case),
        base_frame=robot.base_frame,
        tool_link=robot.tool_link,
        registration=None,
        max_drift=DriftBound(registration.max_drift_mm, registration.max_drift_rad),
        follows_tool=robot.joint_states is None,
    )
    result, link_from_tip = register_robot(case, unregistered, margins)
    return replace(unregistered, registration=result, link_from_tip=link_from_tip)


class ToolEngines:
    """Makes the `ProximityEngine` of each case in turn, by one thread.

    The tool of the last engine is not prepared again where the next one has the same surface. The
    engines give the same results as new ones.
    """

    def __init__(self) -> None:
        self._last: tuple[SurfaceMesh, ProximityEngine] | None = None

    def __call__(self, tumor: SurfaceMesh, tool: SurfaceMesh) -> ProximityEngine:
        """The engine for ``tumor`` and ``tool``; raises `MeshError` as its constructor."""
        if self._last is not None and _same(self._last[0], tool):
            engine = self._last[1].with_tumor(prepared_tumor(tumor))
        else:
            engine = ProximityEngine(tumor, tool)
        self._last = tool, engine
        return engine


def _same(one: SurfaceMesh, other: SurfaceMesh) -> bool:
    return (
        one.frame == other.frame
        and np.array_equal(one.vertices_mm, other.vertices_mm)
        and np.array_equal(one.faces, other.faces)
    )
