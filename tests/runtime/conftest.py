"""The recorded case of the tests of runs: its dwells and its first breach."""

import pytest

from app.case import open_case
from app.geometry import NS_PER_S
from app.runtime import PreparedCase, prepare_case
from tests.shipped_case import DEEP, SHIPPED_CASE

DWELLS_END_S = 19.0


@pytest.fixture(scope="session")
def recorded_case() -> PreparedCase:
    """The case without the surface of the tool: preparing the whole one takes a second longer."""
    frames = list(open_case(SHIPPED_CASE).recorded_frames())
    windows = ((0.0, DWELLS_END_S), (DEEP["start_s"] - 1.5, DEEP["end_s"] + 1.5))
    kept = tuple(
        frame
        for frame in frames
        if any(
            low <= (frame.stamp.ns - frames[0].stamp.ns) / NS_PER_S <= high for low, high in windows
        )
    )
    return prepare_case(SHIPPED_CASE, tip_only=True, frames=kept)
