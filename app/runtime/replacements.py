"""Checks of a tumour or a tip that replaces that of a running session."""

from app.fixture import ProximityEngine, TipProximity
from app.geometry import FrameError, InputError, SurfaceMesh, Transform
from app.runtime.compute import Compute
from app.runtime.content import SessionContent
from app.session import ProximityModel, SessionSetup, prepare_replacement, tumor_change

MAX_LIVE_TRIANGLES = 400_000
"""Triangles of a tumour that replaces another one in a live session. They are prepared in seconds,
in compiled code and NumPy, which release the interpreter, so that the constraint is sent
meanwhile."""


def check_size(tumor: SurfaceMesh, max_triangles: int | None) -> None:
    """Raise `InputError` for a tumour of more triangles; None allows all."""
    if max_triangles is not None and len(tumor.faces) > max_triangles:
        raise InputError(
            f"tumour: has {len(tumor.faces)} triangles; expected at most {max_triangles} in a "
            "live session: reduce its resolution"
        )


def replacement_for(
    setup: SessionSetup,
    shown: SessionContent,
    frame_from_tumor: Transform,
    tumor: SurfaceMesh,
    compute: Compute,
) -> tuple[ProximityModel, str]:
    """The model of ``tumor``, and its change from that of ``shown``, which was acknowledged.

    ``compute`` calls what takes long. Raises `InputError` for a session whose tool is unknown.
    """
    before = shown.tumor.transformed(shown.frame_from_tumor)
    model: ProximityModel
    if isinstance(setup.proximity, TipProximity):
        model = TipProximity(tumor)
    elif shown.tool is None:
        raise InputError(
            "tumour: cannot be replaced, because the tool's surface is unknown; expected a "
            "session with a tool mesh"
        )
    elif isinstance(setup.proximity, ProximityEngine):
        made = compute(prepare_replacement, before, tumor, frame_from_tumor)
        return setup.proximity.with_tumor(made.prepared), made.change.text
    else:
        model = ProximityEngine(tumor, shown.tool)
    change = compute(tumor_change, before, tumor.transformed(frame_from_tumor))
    return model, change.text


MAX_TIP_SIGMA_MM = 10.0
"""Largest uncertainty of a calibrated tip."""

_SAME_AXIS_RAD = 1e-6


def check_tip(setup: SessionSetup, tool_from_tip: Transform, sigma_mm: float) -> None:
    """Raise unless ``tool_from_tip`` can replace the tip of the tool of ``setup``.

    `FrameError` for a tip between other frames, `InputError` for an uncertainty out of range, and
    for another axis of a tool whose mount on a robot was found with the axis in use.
    """
    known, robot = setup.tool_from_tip, setup.robot
    if (tool_from_tip.target, tool_from_tip.source) != (known.target, known.source):
        raise FrameError(
            f"tip: is {tool_from_tip.target}_from_{tool_from_tip.source}; expected "
            f"{known.target}_from_{known.source}"
        )
    if not 0.0 <= sigma_mm <= MAX_TIP_SIGMA_MM:
        raise InputError(
            f"uncertainty of the tip: is {sigma_mm:.6g} mm; expected 0 to {MAX_TIP_SIGMA_MM:g} mm"
        )
    is_mounted = robot is not None and robot.link_from_tip is not None
    if is_mounted and known.angle_to(tool_from_tip) > _SAME_AXIS_RAD:
        raise InputError(
            "tip: has another axis than the one with which the robot was registered; "
            "expected the same axis, or a session that is registered with the new one"
        )
