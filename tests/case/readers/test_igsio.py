import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.case import read_igsio, read_recording
from app.case.readers.igsio.igsio_header import check_igsio_header
from app.geometry import InputError, Stamp, TrackingStatus
from tests.oracles.igsio_text import igsio_samples, igsio_times_s
from tests.refusals import refused

ONE = "1 0 0 1.5 0 1 0 -2 0 0 1 3e-005 -0 0 -0 1 "
HEAD = "ObjectType = Image\nNDims = 3\nDimSize = 0 0 2              \nElementType = MET_OTHER\n"
END = "ElementDataFile = LOCAL\n"


def read(path: Path) -> tuple[list, list[str]]:
    notes: list[str] = []
    return list(read_igsio(path, notes.append)), notes


def mha(tmp_path: Path, body: str, end: bytes = END.encode()) -> Path:
    path = tmp_path / "x.igs.mha"
    path.write_bytes((HEAD + body).encode() + end)
    return path


def frame(index: int, *fields: str) -> str:
    return "".join(f"Seq_Frame{index:04d}_{field}\n" for field in fields)


@pytest.mark.parametrize(
    ("name", "count"),
    [("EightLandmarkPointsTrackedForPhantomRegistration", 1000), ("ReferenceToRASCalibration", 93)],
)
def test_real_recordings_agree_with_an_independent_parse(real_recording, name, count):
    path = real_recording(name)
    frames, notes = read(path)
    assert (len(frames), notes) == (count, [])
    for source in ("Stylus", "Reference"):
        samples = igsio_samples(path, f"{source}ToTracker")
        assert len(samples.matrices) == count
        found = [pose for one in frames for pose in one.poses if pose.source == source.lower()]
        assert {pose.target for pose in found} == {"tracker"}
        assert [pose.status.name for pose in found] == list(samples.statuses)
        known = [pose.transform is not None for pose in found]
        matrices = np.array([pose.transform.matrix for pose in found if pose.transform])
        # The reader projects the printed, rounded matrix to the nearest rotation.
        np.testing.assert_array_equal(matrices[:, :3, 3], samples.matrices[known][:, :3, 3])
        np.testing.assert_allclose(matrices, samples.matrices[known], atol=5e-4)
    for time_s, one in zip(igsio_times_s(path), frames, strict=True):
        assert abs(one.stamp.ns - time_s * 1e9) < 64  # rounding of a double at 350 s


def test_statuses_names_and_clocks_of_a_frame_are_read(tmp_path):
    body = frame(
        0,
        f"StylusToTrackerTransform = {ONE}",
        "StylusToTrackerTransformStatus = OK",
        f"ProbeTransform = {ONE}",
        f"NeedleToReferenceTransform = {ONE}",
        "NeedleToReferenceTransformStatus = INVALID",
        f"CameraToTrackerTransform = {ONE}",
        "CameraToTrackerTransformStatus = OUT_OF_VIEW",
        f"OtherToTrackerTransform = {ONE}",
        "OtherToTrackerTransformStatus = NEW_WORD",
        "Timestamp = 12.000000001",
        "UnfilteredTimestamp = 11.9",
        "ImageStatus = INVALID",
        "FrameNumber = 7",
    )
    ((one,), notes) = read(mha(tmp_path, body))
    assert one.stamp == Stamp(12_000_000_001)
    assert one.unfiltered_stamp == Stamp(11_900_000_000)
    samples = {(p.target, p.source): p for p in one.poses}
    assert {edge: p.status.name for edge, p in samples.items()} == {
        ("tracker", "stylus"): "OK",
        ("tracker", "probe"): "OK",
        ("reference", "needle"): "INVALID",
        ("tracker", "camera"): "OUT_OF_VIEW",
        ("tracker", "other"): "INVALID",
    }
    pose = samples["tracker", "stylus"].transform
    assert pose is not None
    np.testing.assert_array_equal(pose.translation_mm, [1.5, -2.0, 3e-5])
    assert len(notes) == 1 and "'Probe'" in notes[0] and "'tracker'" in notes[0]


@pytest.mark.parametrize(
    ("row", "status"),
    [
        (ONE.replace("1.5", "nan"), TrackingStatus.NOT_FINITE),
        (ONE.replace("1.5", "-inf"), TrackingStatus.NOT_FINITE),
        (ONE.replace("1 0 0", "1.5 0 0", 1), TrackingStatus.NOT_RIGID),
        (ONE.replace("1 0 0", "-1 0 0", 1), TrackingStatus.NOT_RIGID),
        ("0 " * 16, TrackingStatus.NOT_RIGID),
    ],
)
def test_invalid_poses_become_a_status(tmp_path, row, status):
    ((one,), _) = read(mha(tmp_path, frame(0, f"AToBTransform = {row}", "Timestamp = 1")))
    assert [(p.status, p.transform) for p in one.poses] == [(status, None)]


def test_frame_without_timestamp_is_skipped_with_a_note(tmp_path):
    row = f"AToBTransform = {ONE}"
    path = mha(tmp_path, frame(0, row) + frame(1, row, "Timestamp = 1"))
    frames, notes = read(path)
    assert [one.stamp.ns for one in frames] == [10**9]
    assert notes == ["frame 0 has no Timestamp: skipped"]


def test_clock_jumps_and_missing_transforms_are_kept(tmp_path):
    row = f"AToBTransform = {ONE}"
    path = mha(
        tmp_path,
        frame(0, row, "Timestamp = 5") + frame(1, "Timestamp = 4") + frame(7, row, "Timestamp = 6"),
    )
    frames, _ = read(path)
    assert [(one.stamp.ns // 10**9, len(one.poses)) for one in frames] == [(5, 1), (4, 0), (6, 1)]


def test_ambiguous_names_are_skipped_with_a_note(tmp_path):
    row = f"AToBToCTransform = {ONE}"
    frames, notes = read(
        mha(tmp_path, frame(0, row, "Timestamp = 1") + frame(1, row, "Timestamp = 2"))
    )
    assert [one.poses for one in frames] == [(), ()]
    assert len(notes) == 1 and "AToBToC" in notes[0]


def test_images_are_not_read(tmp_path):
    body = frame(0, f"AToBTransform = {ONE}", "Timestamp = 1")
    junk = b"\x00\xff\nSeq_Frame0001_Timestamp = 2\n" + bytes(range(256)) * 50
    frames, _ = read(mha(tmp_path, body, b"CompressedData = True\n" + END.encode() + junk))
    assert len(frames) == 1


def test_a_file_is_never_held_in_memory(tmp_path):
    rows = [f"AToBTransform = {ONE}", "Timestamp = 1"]
    path = mha(tmp_path, "".join(frame(index, *rows) for index in range(1000)))
    with path.open("r+b") as file:
        file.truncate(1 << 30)  # a sparse gigabyte of pictures
    tracemalloc.start()
    try:
        assert sum(1 for _ in read_igsio(path, str)) == 1000
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 500_000


@pytest.mark.parametrize(
    ("second", "status"),
    [
        (ONE, "OK"),
        (ONE.replace("1.5", "1.6"), "INVALID"),
        (ONE.replace("1 ", "2 ", 1), "NOT_RIGID"),
    ],
)
def test_two_names_of_one_edge_that_differ_are_invalid(tmp_path, second, status):
    rows = [f"AToBTransform = {ONE}", f"aToBTransform = {second}", "Timestamp = 1"]
    ((one,), _) = read(mha(tmp_path, frame(0, *rows)))
    assert [(p.target, p.source, p.status.name) for p in one.poses] == [("b", "a", status)]


def test_nrrd_header_is_read(tmp_path):
    path = tmp_path / "x.igs.nrrd"
    head = (
        "NRRD0004\n# a comment\ntype: unsigned char\ndimension: 3\nsizes: 0 0 1\n"
        f"Seq_Frame0000_StylusToTrackerTransform:={ONE}\n"
        "Seq_Frame0000_StylusToTrackerTransformStatus:=OK\n"
        "Seq_Frame0000_Timestamp:=2.5\n"
    )
    path.write_bytes(head.encode() + b"\n\x1f\x8b\x00Seq_Frame0001_Timestamp:=3\n")
    ((one,), notes) = read(path)
    assert (one.stamp.ns, one.poses[0].source, notes) == (2_500_000_000, "stylus", [])
    path.write_bytes(head.encode())
    with pytest.raises(InputError, match=r"cut at line 8, in frame 0: .* empty line"):
        check_igsio_header(path)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (frame(0, "AToBTransform = 1 2 3", "Timestamp = 1"), r"line 5 \(frame 0.*3 numbers; exp"),
        (frame(0, "AToBTransform = " + "x " * 16, "Timestamp = 1"),
         r"line 5 .*'x' is not a number"),
        (frame(0, "AToBTransform = " + "1_0 " * 16, "Timestamp = 1"), r"'1_0' is not a number"),
        (frame(0, f"AToBTransform = {ONE}", f"AToBTransform = {ONE}", "Timestamp = 1"),
         r"line 6 \(frame 0\): AToBTransform is repeated, first in line 5"),
        (frame(0, "Timestamp = 1_0"), r"'1_0' is not a finite number"),
        (frame(0, "Timestamp = soon"), r"line 5 \(frame 0, Timestamp\): time 'soon'"),
        (frame(0, "Timestamp = nan"), r"'nan' is not a finite number"),
        (frame(1, "Timestamp = 1") + frame(0, "Timestamp = 2"), r"frame 0 comes after frame 1"),
        ("no field\n", r"line 5: 'no field' is not a header field"),
        ("x" * 1_000_001 + "\n", r"line 5 is longer"),
    ],
)  # fmt: skip
def test_malformed_headers_are_refused_with_their_line(tmp_path, body, message):
    with refused(message):
        read(mha(tmp_path, body))


WHOLE = (
    HEAD
    + "".join(
        frame(i, f"StylusToTrackerTransform = {ONE}", f"Timestamp = {i}.25") for i in range(4)
    )
    + END
)


@settings(max_examples=30)
@given(cut=st.integers(0, len(WHOLE) - len(" = LOCAL\n")))
def test_a_header_cut_anywhere_is_refused_in_one_line(tmp_path_factory, cut):
    path = tmp_path_factory.mktemp("cut") / "x.igs.mha"
    path.write_text(WHOLE[:cut])
    for reading in (check_igsio_header, read):
        with refused(r"is cut at line \d+, (before any|in) frame"):
            reading(path)


def test_cut_header_is_refused_with_its_frame(tmp_path):
    path = tmp_path / "x.igs.mha"
    path.write_text(
        WHOLE[: WHOLE.index("Seq_Frame0002_Timestamp = 2.2") + len("Seq_Frame0002_Timest")]
    )
    with pytest.raises(InputError, match="cut at line 10, in frame 2"):
        check_igsio_header(path)


def test_frame_with_too_many_fields_is_refused(tmp_path):
    body = "".join(f"Seq_Frame0000_Field{number} = 1\n" for number in range(1100))
    with pytest.raises(InputError, match="frame 0 has more than 1024 fields"):
        read(mha(tmp_path, body))


def test_too_many_transforms_are_refused(tmp_path):
    numbers = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"
    body = "".join(
        f"Seq_Frame{number:04}_A{number}ToBTransform = {numbers}\n"
        f"Seq_Frame{number:04}_Timestamp = {number}\n"
        for number in range(1030)
    )
    with pytest.raises(InputError, match="transform 'A1024ToB' is one too many; expected 1024"):
        read(mha(tmp_path, body))


def test_frames_without_times_need_a_stated_rate(tmp_path):
    body = "".join(frame(index, f"StylusToTrackerTransform = {ONE}") for index in range(5))
    path = mha(tmp_path, body)
    with pytest.raises(InputError, match=r"no frame with a Timestamp, but 5 without; .*rate_hz"):
        read(path)
    notes: list[str] = []
    frames = list(read_recording(path, notes.append, rate_hz=20.0))
    assert [one.stamp.ns for one in frames] == [50_000_000 * index for index in range(5)]
    assert notes == ["the frames have no times: taken at 20 Hz, as stated"]


def test_stated_rate_is_refused_where_frames_have_times(tmp_path):
    path = mha(tmp_path, frame(0, f"StylusToTrackerTransform = {ONE}", "Timestamp = 1"))
    with pytest.raises(InputError, match=r"frame 0 has a Timestamp; expected none with a stated"):
        list(read_recording(path, print, rate_hz=20.0))


def test_images_without_tracking_are_no_recording(tmp_path):
    body = "".join(frame(index, f"Timestamp = {index}", "ImageStatus = OK") for index in range(3))
    with pytest.raises(InputError, match="holds 3 images without tracking; expected fields like"):
        read(mha(tmp_path, body))
    with pytest.raises(InputError, match="is not a recording of a tracker: its header has no"):
        read(mha(tmp_path, "Comment = none\n"))


@pytest.mark.parametrize("name", ["x.igs.mhd", "x.seq.mha", "x.seq.mhd"])
def test_header_with_its_data_elsewhere_is_read(tmp_path, name):
    path = tmp_path / name
    body = frame(0, f"StylusToTrackerTransform = {ONE}", "Timestamp = 1")
    path.write_text(HEAD + body + "ElementDataFile = x.zraw\n")
    (one,) = read_recording(path, print)
    assert [(pose.source, pose.target) for pose in one.poses] == [("stylus", "tracker")]


def test_sequence_of_slicer_has_the_frames_in_one_word_of_its_names(tmp_path):
    path = tmp_path / "Recording.seq.mha"
    body = frame(0, f"Recording-NeedleToReference-SeqTransform = {ONE}", "Timestamp = 1")
    path.write_text(HEAD + body + END)
    (one,) = read_recording(path, print)
    assert [(pose.source, pose.target) for pose in one.poses] == [("needle", "reference")]
