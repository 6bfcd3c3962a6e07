"""The recorded case of the tests of runs: its dwells and its first breach."""

import pytest

from app.case import open_case
from app.geometry import NS_PER_S
from app.runtime import PreparedCase, prepare_case
from tests.shipped_case import DEEP, SHIPPED_CASE

DWELLS_END_S = 19.0


@pytest.fixture(scope="session")
def recorded_case() -> PreparedCase:
    """The case without the surface of the tool, with every second frame: 20 Hz."""
    frames = list(open_case(SHIPPED_CASE).recorded_frames())[::2]
    times_s = [(frame.stamp.ns - frames[0].stamp.ns) / NS_PER_S for frame in frames]
    near = (DEEP["start_s"] - 1.5, DEEP["end_s"] + 1.5)
    kept = tuple(
        frame
        for frame, at_s in zip(frames, times_s, strict=True)
        if at_s < DWELLS_END_S or near[0] < at_s < near[1]
    )
    return prepare_case(SHIPPED_CASE, tip_only=True, frames=kept)
