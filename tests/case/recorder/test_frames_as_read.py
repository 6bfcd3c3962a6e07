from dataclasses import replace

import pytest

from app.case.recorder.frames_as_read import frames_as_read
from app.geometry import InputError


def test_frames_without_poses_or_with_falling_stamps_are_refused(frames):
    written = list(frames(4))
    with pytest.raises(InputError, match="has 0 poses; expected poses"):
        frames_as_read([written[0], replace(written[1], poses=())])
    with pytest.raises(InputError, match="stamps that rise"):
        frames_as_read(written[::-1])
    assert frames_as_read([]) == ()
