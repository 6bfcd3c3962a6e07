"""The model of a tumour that replaces another one in a running session."""

from app.fixture import ProximityEngine, TipProximity
from app.geometry import InputError, SurfaceMesh, Transform
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
