"""Which samples of a recording are poses of a tool, and where its tip is said to be."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.cli.calibration.recording import Recording, follow_tool
from app.cli.calibration.tip import known_tip
from app.geometry import InputError
from tests.cli.calibration.recordings import TIP_MM, frames, pivoting


def recorded(count: int) -> Recording:
    """The stylus in every other frame alone, the reference in all of them."""
    every = frames(pivoting(np.random.default_rng(1), count, 60.0), {})
    thinned = [
        frame
        if number % 2 == 0
        else replace(frame, poses=tuple(p for p in frame.poses if p.source != "stylus"))
        for number, frame in enumerate(every)
    ]
    return Recording(Path("x.igs.mha"), tuple(thinned), None, ())


def test_a_pose_that_stands_while_another_sensor_is_read_is_one_sample() -> None:
    """Counted twice it would make a calibration surer than it is."""
    track = follow_tool(recorded(20), tool="stylus", reference="reference", max_age_ms=60.0)
    stamps = [sample.stamp.ns for sample in track.samples]
    assert len(stamps) == len(set(stamps)) == 10


def test_samples_of_two_moments_are_no_pose_unless_asked_for() -> None:
    track = follow_tool(recorded(20), tool="stylus", reference="reference")
    assert len(track.samples) == 10
    assert "10 of 20 frames left out" in track.notes[0]


def test_the_tip_may_come_from_a_plus_configuration(tmp_path: Path) -> None:
    matrix = " ".join(map(str, [1, 0, 0, TIP_MM[0], 0, 1, 0, TIP_MM[1], 0, 0, 1, TIP_MM[2]]))
    path = tmp_path / "plus.xml"
    path.write_text(
        "<PlusConfiguration><CoordinateDefinitions><Transform From='StylusTip' To='Stylus' "
        f"Matrix='{matrix} 0 0 0 1'/></CoordinateDefinitions></PlusConfiguration>"
    )
    tip = known_tip(recorded(2), "stylus", tip_from=path, plus=None)
    assert (tip.target, tip.source) == ("stylus", "stylus_tip")
    np.testing.assert_array_equal(tip.translation_mm, TIP_MM)
    with pytest.raises(InputError, match="has no NeedleTipToNeedle: StylusTipToStylus given"):
        known_tip(recorded(2), "needle", tip_from=path, plus=None)
