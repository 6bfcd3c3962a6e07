import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.case import open_case, read_recording, readers, recording_formats, recording_kinds
from app.geometry import InputError
from tests.case.conftest import add_robot
from tests.python_process import run_python

Manifest = dict[str, Any]
WriteCase = Callable[..., Path]

IGSIO = (".igs.mha", ".igs.mhd", ".igs.nrrd", ".igs.nhdr", ".seq.mha", ".seq.mhd", ".seq.nrrd")
PERK_TUTOR = (".xml of PerkTutor",)
KINDS = ", ".join((*IGSIO, ".mrb", ".mrml", *PERK_TUTOR, ".mcap", "a rosbag2 folder"))
NEW_FORMAT = '''
"""Poses as lines of comma-separated numbers: time in s, x, y, z in mm."""

import numpy as np

from app.case import SideTopics, RecordingFormat, TrackingFrame, has_ending
from app.geometry import InputError, Stamp, TrackedTransform, TrackingStatus, Transform


def _read(path, note, joints):
    for line in path.read_text().splitlines():
        time_s, *position_mm = map(float, line.split(","))
        stamp = Stamp(round(time_s * 1e9))
        pose = Transform("reference", "cautery", np.eye(3), np.array(position_mm))
        yield TrackingFrame(stamp, (TrackedTransform(pose, stamp, TrackingStatus.OK),))
    note("read as CSV")


def _check(path):
    if not path.read_text():
        raise InputError(f"{path} is empty; expected a line per pose")


FORMAT = RecordingFormat(
    kinds=(".csv",), recognises=has_ending(".csv"), read=_read, check=_check
)
'''


@pytest.fixture
def csv_format(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A format that is one more file among the readers."""
    folder = tmp_path / "more_readers"
    folder.mkdir()
    (folder / "csv_poses.py").write_text(NEW_FORMAT)
    monkeypatch.setattr(readers, "__path__", [*readers.__path__, str(folder)])
    yield
    sys.modules.pop("app.case.readers.csv_poses", None)


def write_csv_case(write_case: WriteCase, manifest: Manifest, text: str) -> Path:
    """A case whose recording is the CSV file ``text``."""
    manifest["recording"] = {"path": "poses.CSV"}
    folder = write_case(manifest)
    (folder / "poses.CSV").write_text(text)
    return folder


def test_formats_are_found_with_fallbacks_last():
    kinds = [each.kinds for each in recording_formats()]
    assert kinds == [IGSIO, (".mrb", ".mrml"), PERK_TUTOR, (".mcap", "a rosbag2 folder")]
    assert recording_kinds() == KINDS


def test_each_module_among_the_readers_is_a_format():
    modules = {path.stem for path in Path(readers.__path__[0]).iterdir() if path.stem[0] != "_"}
    assert len(recording_formats()) == len(modules - {"recording_format"})


@pytest.mark.usefixtures("csv_format")
def test_new_format_is_one_file_that_is_checked_when_the_case_is_opened(manifest, write_case):
    folder = write_csv_case(write_case, manifest, "1.5,1,2,3\n1.75,4,5,6\n")
    case = open_case(folder)
    first, *_, last = case.frames()
    assert (first.stamp.ns, last.stamp.ns) == (1_500_000_000, 1_750_000_000)
    np.testing.assert_array_equal(last.poses[0].transform.translation_mm, [4.0, 5.0, 6.0])
    assert case.notes() == ("read as CSV",)
    assert recording_kinds() == f".csv, {KINDS}"
    (folder / "poses.CSV").write_text("")
    with pytest.raises(InputError, match=r"poses\.CSV is empty; expected a line per pose"):
        open_case(folder)


@pytest.mark.usefixtures("csv_format")
def test_new_format_without_joints_cannot_serve_a_robot(manifest, write_case):
    add_robot(manifest, "arm.urdf", joint_states="/joint_states")
    folder = write_csv_case(write_case, manifest, "1.5,1,2,3\n")
    (folder / "arm.urdf").write_text("<robot/>")
    with pytest.raises(InputError, match=r"poses\.CSV cannot hold joints"):
        open_case(folder)


def test_unknown_recording_is_refused_with_all_kinds(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("1,2,3,4")
    with pytest.raises(InputError, match=r"poses\.csv is not a recording; expected one of \.igs"):
        read_recording(path, print)


def test_help_texts_load_no_reader():
    code = "import sys, app.case; app.case.recording_kinds(); print(*sys.modules)"
    done = run_python("-c", code)
    loaded = set(done.stdout.split())
    assert loaded & {"numpy", "rosbags", "mcap", "app.geometry.stamp"} == set()
    assert "app.case.readers.igsio" in loaded
