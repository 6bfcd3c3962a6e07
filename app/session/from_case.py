"""A session for a recorded case: manifest, meshes and robot put together, the base registered."""

from app.case import Case
from app.fixture import MarginParameters, ProximityEngine, TipProximity
from app.geometry import InputError
from app.registration import RegistrationResult, given_registration, register_points
from app.robot import load_robot
from app.session.pose_tree import PoseTree
from app.session.registering import register_at_dwells
from app.session.setup import REFERENCE, ProximityModel, RobotSetup, SessionSetup


def setup_from_case(case: Case, *, tip_only: bool = False) -> SessionSetup:
    """What a session needs for ``case``; with ``tip_only`` the tool is its tip and nothing else.

    Reads the recording up to its last landmark dwell where the registration needs that.
    """
    manifest = case.manifest
    margins = margin_parameters(case)
    tumor = case.tumor_mesh()
    proximity: ProximityModel = (
        TipProximity(tumor) if tip_only else ProximityEngine(tumor, case.tool_mesh())
    )
    return SessionSetup(
        tool_from_tip=manifest.tool.tool_from_tip,
        frame_from_tumor=manifest.tumor.frame_from_tumor,
        proximity=proximity,
        margins=margins,
        robot=_robot_setup(case, margins),
    )


def margin_parameters(case: Case) -> MarginParameters:
    """The margins of the manifest, in the form that the monitor checks and uses."""
    entry = case.manifest.margins
    return MarginParameters(
        stop_mm=entry.stop_mm,
        warn_mm=entry.warn_mm,
        k_tre=entry.k_tre,
        v_max_mm_s=entry.v_max_mm_s,
        stale_after_ns=entry.stale_after_ns,
        release_samples=entry.release_samples,
        release_band_mm=entry.release_band_mm,
        frozen_after_ns=entry.frozen_after_ns,
    )


def _robot_setup(case: Case, margins: MarginParameters) -> RobotSetup | None:
    entry = case.manifest.robot
    if entry is None:
        return None
    robot = load_robot(case.robot_urdf(), package_dirs=case.package_dirs)
    # Twice, because the link has to be there before the registration can use it.
    unregistered = RobotSetup(robot, entry.base_frame, entry.tool_link, None)
    return RobotSetup(
        robot, entry.base_frame, entry.tool_link, _register(case, unregistered, margins)
    )


def _register(case: Case, setup: RobotSetup, margins: MarginParameters) -> RegistrationResult:
    entry = case.manifest.registration
    if entry is None:
        raise InputError(f"case {case.manifest.name!r} has a robot: a registration is wanted")
    if entry.method == "given" and entry.reference_from_base is not None:
        return given_registration(entry.reference_from_base)
    if entry.method == "paired_points" and entry.fixed_mm:
        return register_points(
            entry.fixed_mm, entry.moving_mm, fixed_frame=REFERENCE, moving_frame=setup.base_frame
        )
    if entry.method == "paired_points":
        return register_at_dwells(
            case.frames(),
            entry.dwells,
            PoseTree(margins.stale_after_ns, margins.frozen_after_ns, case.manifest.tool.frame),
            tool_from_tip=case.manifest.tool.tool_from_tip,
            robot=setup.robot,
            base_frame=setup.base_frame,
            tool_link=setup.tool_link,
        )
    raise InputError(
        f"registration.method {entry.method!r} cannot be replayed yet: "
        "'given' or 'paired_points' wanted"
    )
