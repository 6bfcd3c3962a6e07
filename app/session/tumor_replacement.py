"""A tumour that replaces another one, prepared and compared with it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.fixture.proximity.engine import PreparedTumor, checked_tumor, prepared_checked
from app.fixture.surfaces.winding_number import winding_numbers
from app.geometry import FloatArray, SurfaceMesh, Transform
from app.session.tumor_change import TumorChange, tumor_change


class TumorReplacement(NamedTuple):
    """A tumour prepared for `app.fixture.ProximityEngine`, and its change from another one."""

    prepared: PreparedTumor
    change: TumorChange


def prepare_replacement(
    before: SurfaceMesh, tumor: SurfaceMesh, frame_from_tumor: Transform
) -> TumorReplacement:
    """Check and prepare ``tumor``, and compare it with ``before``, in the frame of that.

    One function for both, because the comparison needs the tree that the check has built. Raises
    `MeshError` for a surface that bounds no solid, and `FrameError` if ``frame_from_tumor`` does
    not lead from the frame of ``tumor`` to that of ``before``.
    """
    checked = checked_tumor(tumor)
    tumor_from_frame = frame_from_tumor.inverse()

    def inside_tumor(points_mm: FloatArray) -> NDArray[np.bool_]:
        numbers = winding_numbers(checked.dipoles, tumor_from_frame.apply(points_mm))
        return np.asarray(numbers > 0)

    change = tumor_change(before, tumor.transformed(frame_from_tumor), inside_tumor)
    return TumorReplacement(prepared_checked(checked), change)
