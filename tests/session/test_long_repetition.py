"""Freezes of each sensor, injected while the tool moves and while it rests, are detected."""

import pytest

from tests.session.frozen_sensors import clean_run, inject, moments, quantised, recorded
from tests.shipped_case import SHIPPED_CASE

pytestmark = pytest.mark.long


@pytest.mark.parametrize(
    "recording",
    [quantised, lambda: recorded(SHIPPED_CASE / "tracking.mcap")],
    ids=["quantised", "shipped case"],
)
def test_recording_is_never_frozen_and_each_freeze_is_detected(recording):
    found = recording()
    assert clean_run(found)[1] == 0
    tried = 0
    for at in [at for moving in (True, False) for at in moments(found, moving, 20)]:
        for sensors in ((found.tool,), (found.reference,), found.sensors):
            assert inject(found, at, sensors).frozen_ms is not None, (at, sensors)
            tried += 1
    assert tried >= 60
