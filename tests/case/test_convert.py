from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from app.case import convert_case, open_case
from app.geometry import InputError

Manifest = dict[str, Any]
WriteCase = Callable[..., Path]
Same = Callable[..., None]


@pytest.fixture
def real_case(
    manifest: Manifest, write_case: WriteCase, real_recording: Callable[[str], Path]
) -> Path:
    name = "EightLandmarkPointsTrackedForPhantomRegistration.igs.mha"
    manifest["recording"] = {"path": name}
    manifest["tool"]["frame"] = "stylus"
    manifest["expected"] = "expected.yaml"
    folder = write_case(manifest)
    (folder / "tracking.mcap").unlink()
    (folder / "expected.yaml").write_text("frames: 1000\n")
    (folder / name).write_bytes(real_recording(name).read_bytes())
    return folder


def test_real_recording_is_converted_unchanged(
    real_case: Path, tmp_path: Path, same_frames: Same
) -> None:
    case = open_case(real_case)
    assert convert_case(case, tmp_path / "converted") == ()
    converted = open_case(tmp_path / "converted")
    assert converted.manifest.recording.sha256 is not None
    assert converted.expected() is not None
    pairs = list(zip(case.recorded_frames(), converted.recorded_frames(), strict=True))
    assert len(pairs) == 1000
    for one, other in pairs:
        same_frames(one, other, atol_mm=1e-9)
    assert not (tmp_path / "converted" / case.recording_path.name).exists()


def test_joints_statuses_and_both_clocks_are_converted(
    manifest: Manifest, write_case: WriteCase, tmp_path: Path, same_frames: Same
) -> None:
    manifest["clock"] = {"offset_robot_to_tracker_ms": -12.5}
    manifest["robot"] = {
        "urdf": "arm/arm.urdf",
        "base_frame": "base",
        "tool_link": "stylus",
        "joint_states": "/joint_states",
    }
    manifest["registration"] = {"method": "paired_points", "dwells": [{"start_s": 0, "end_s": 1}]}
    folder = write_case(manifest)
    (folder / "arm/meshes").mkdir(parents=True)
    (folder / "arm/arm.urdf").write_text("<robot/>")
    (folder / "arm/meshes/link.stl").write_text("x")
    case = open_case(folder)
    convert_case(case, tmp_path / "a" / "converted")
    converted = open_case(tmp_path / "a" / "converted")
    assert (converted.robot_urdf().parent / "meshes/link.stl").is_file()
    for one, other in zip(case.frames(), converted.frames(), strict=True):
        same_frames(one, other)
    before, after = (
        yaml.safe_load((c.folder / "case.yaml").read_text()) for c in (case, converted)
    )
    del before["recording"], after["recording"]
    assert before == after


def test_existing_files_are_not_overwritten(
    manifest: Manifest, write_case: WriteCase, tmp_path: Path
) -> None:
    case = open_case(write_case(manifest))
    (tmp_path / "there").mkdir()
    with pytest.raises(InputError, match="refusing to overwrite it"):
        convert_case(case, tmp_path / "there")
    assert list((tmp_path / "there").iterdir()) == []


def test_failed_conversion_leaves_no_folder(
    manifest: Manifest, write_case: WriteCase, tmp_path: Path
) -> None:
    manifest["recording"]["path"] = "x.igs.mha"
    folder = write_case(manifest)
    (folder / "x.igs.mha").write_text(
        "Seq_Frame0000_Timestamp = 1\nSeq_Frame0001_Timestamp = soon\nElementDataFile = LOCAL\n"
    )
    with pytest.raises(InputError, match="'soon'"):
        convert_case(open_case(folder), tmp_path / "converted")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["case"]
