"""Extraction of a tool's track from a recording, and the sources of its tip."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.cli.calibration.calibration_inputs import Recording, extract_tool_track, read_tip
from app.geometry import InputError
from tests.cli.calibration.recordings import TIP_MM, frames, pivoting


def recorded(count: int) -> Recording:
    """A recording of ``count`` frames: the reference in all, the stylus in every other one."""
    every = frames(pivoting(np.random.default_rng(1), count, 60.0), {})
    thinned = [
        frame
        if number % 2 == 0
        else replace(frame, poses=tuple(p for p in frame.poses if p.source != "stylus"))
        for number, frame in enumerate(every)
    ]
    return Recording(Path("x.igs.mha"), tuple(thinned), None, ())


def test_pose_repeated_while_another_sensor_is_read_is_one_sample():
    """Counting it twice would make the predicted error of a calibration too small."""
    track = extract_tool_track(recorded(20), tool="stylus", reference="reference", max_age_ms=60.0)
    stamps = [sample.stamp.ns for sample in track.samples]
    assert len(stamps) == len(set(stamps)) == 10


def test_samples_of_different_times_are_combined_only_within_max_age():
    track = extract_tool_track(recorded(20), tool="stylus", reference="reference")
    assert len(track.samples) == 10
    assert "10 of 20 frames left out" in track.notes[0]


def test_tip_may_come_from_a_plus_configuration(tmp_path):
    matrix = " ".join(map(str, [1, 0, 0, TIP_MM[0], 0, 1, 0, TIP_MM[1], 0, 0, 1, TIP_MM[2]]))
    path = tmp_path / "plus.xml"
    path.write_text(
        "<PlusConfiguration><CoordinateDefinitions><Transform From='StylusTip' To='Stylus' "
        f"Matrix='{matrix} 0 0 0 1'/></CoordinateDefinitions></PlusConfiguration>"
    )
    tip = read_tip(recorded(2), "stylus", tip_from=path, plus=None)
    assert (tip.target, tip.source) == ("stylus", "stylus_tip")
    np.testing.assert_array_equal(tip.translation_mm, TIP_MM)
    with pytest.raises(InputError, match="has no NeedleTipToNeedle; it has StylusTipToStylus"):
        read_tip(recorded(2), "needle", tip_from=path, plus=None)


def test_tool_of_a_plus_configuration_is_the_one_with_a_tip(tmp_path):
    from app.files import read_plus_config

    matrix = "1 0 0 0 0 1 0 0 0 0 1 120 0 0 0 1"
    path = tmp_path / "device_set.xml"
    for sources, tool in (
        (("StylusTip",), "stylus"),
        (("StylusTip", "ProbeTip"), None),
        ((), None),
    ):
        entries = "".join(
            f'<Transform From="{source}" To="{source[:-3]}" Matrix="{matrix}"/>'
            for source in sources
        )
        path.write_text(
            "<PlusConfiguration><CoordinateDefinitions>"
            f'{entries}<Transform From="Image" To="Probe" Matrix="{matrix}"/>'
            "</CoordinateDefinitions></PlusConfiguration>"
        )
        assert read_plus_config(path).tool == tool
