"""Transforms and their status in messages of a PLUS server."""

import math

import numpy as np
import pytest

from app.geometry import TrackedTransform, TrackingStatus
from app.igtl.framing import MessageStream, Refusals
from app.igtl.pose_messages import MAX_EDGES, TYPES, PoseReader
from tests.igtl.conftest import pose
from tests.oracles.pyigtl_peer import message

POSE = pose(10.5, -20.25, 30.0)


class ReadingPipeline:
    """Message stream and pose reader in sequence."""

    def __init__(self) -> None:
        self.refusals = Refusals()
        self.poses = PoseReader(self.refusals)
        self._stream = MessageStream(TYPES, self.refusals)

    def read(self, **fields: object) -> list[TrackedTransform]:
        messages = self._stream.feed(message(**fields).pack())
        return [sample for each in messages for sample in self.poses.read(each)]


@pytest.fixture
def reading() -> ReadingPipeline:
    return ReadingPipeline()


def test_transform_has_frames_pose_and_the_servers_time(reading):
    [sample] = reading.read(name="StylusTipToReference", matrix=POSE, time_s=1_700_000_000.125)
    assert (sample.target, sample.source) == ("reference", "stylus_tip")
    assert sample.stamp.ns == 1_700_000_000_125_000_000
    assert sample.status is TrackingStatus.OK
    assert sample.transform is not None
    np.testing.assert_array_equal(sample.transform.matrix, POSE)


@pytest.mark.parametrize(
    ("metadata", "status"),
    [
        ({}, TrackingStatus.OK),
        ({"TransformStatus": "OK"}, TrackingStatus.OK),
        ({"TransformStatus": "OK", "TransformValid": "True"}, TrackingStatus.OK),
        ({"TransformStatus": "MISSING", "TransformValid": "False"}, TrackingStatus.MISSING),
        ({"TransformStatus": "OUT_OF_VIEW"}, TrackingStatus.OUT_OF_VIEW),
        ({"TransformStatus": "out_of_volume"}, TrackingStatus.OUT_OF_VOLUME),
        ({"TransformStatus": "TOOL_OUT_OF_VIEW"}, TrackingStatus.OUT_OF_VIEW),
        ({"TransformStatus": "REQ_TIMEOUT"}, TrackingStatus.REQUEST_TIMEOUT),
        ({"TransformStatus": "SWITCH1_IS_ON"}, TrackingStatus.INVALID),
        ({"TransformStatus": ""}, TrackingStatus.INVALID),
        ({"TransformValid": "False"}, TrackingStatus.INVALID),
        ({"TransformValid": "0"}, TrackingStatus.INVALID),
        ({"TransformStatus": "OK", "TransformValid": "False"}, TrackingStatus.INVALID),
    ],
)
def test_status_is_read_from_the_metadata(reading, metadata, status):
    [sample] = reading.read(matrix=POSE, metadata=metadata)
    assert sample.status is status
    assert (sample.transform is not None) == (status is TrackingStatus.OK)
    assert reading.poses.without_status == (not metadata or "TransformStatus" not in metadata) * (
        status is TrackingStatus.OK
    )


def test_version_1_header_counts_as_without_status(reading):
    [sample] = reading.read(matrix=POSE, version=1)
    assert sample.status is TrackingStatus.OK
    assert reading.poses.without_status == 1


def test_tdata_elements_have_their_own_name_type_and_status(reading):
    samples = reading.read(
        type="TDATA",
        name="Tracker",
        time_s=7.5,
        elements=[
            ["StylusToTracker", 2, POSE],
            ["NeedleToTracker", 2, pose(1, 2, 3)],
            ["ReferenceToTracker", 1, pose(4, 5, 6)],
            ["PointToTracker", 3, POSE],
            ["WireToTracker", 4, POSE],
            ["Probe", 2, POSE],
        ],
        metadata={
            "StylusToTrackerStatus": "OK",
            "NeedleToTrackerStatus": "MISSING",
            "PointToTrackerStatus": "OK",
        },
    )
    assert [(sample.source, sample.status) for sample in samples] == [
        ("stylus", TrackingStatus.OK),
        ("needle", TrackingStatus.MISSING),
        ("reference", TrackingStatus.OK),
        ("point", TrackingStatus.INVALID),
        ("wire", TrackingStatus.INVALID),
    ]
    assert {sample.stamp.ns for sample in samples} == {7_500_000_000}
    assert {sample.target for sample in samples} == {"tracker"}
    assert samples[0].transform is not None
    np.testing.assert_array_equal(samples[0].transform.matrix, POSE)
    assert reading.refusals.counts == {"FrameError": 1}
    assert "'Probe'" in reading.refusals.last


def changed(row: int, column: int, value: float) -> list[list[float]]:
    matrix = pose(1, 2, 3)
    matrix[row][column] = value
    return matrix


@pytest.mark.parametrize(
    ("matrix", "status"),
    [
        (changed(0, 3, math.nan), TrackingStatus.NOT_FINITE),
        (changed(0, 1, math.inf), TrackingStatus.NOT_FINITE),
        (changed(0, 1, -1.01), TrackingStatus.NOT_RIGID),
        (changed(0, 1, 1.0), TrackingStatus.NOT_RIGID),
        (np.zeros((4, 4)).tolist(), TrackingStatus.NOT_RIGID),
    ],
)
def test_invalid_matrix_is_lost_even_with_status_ok(reading, matrix, status):
    [sample] = reading.read(matrix=matrix, metadata={"TransformStatus": "OK"})
    assert (sample.status, sample.transform) == (status, None)


@pytest.mark.parametrize("time_s", [0.0, 3e9])
def test_invalid_time_is_refused(reading, time_s):
    assert reading.read(matrix=POSE, time_s=time_s) == []
    assert reading.refusals.counts == {"IgtlStampError": 1}
    assert f"time {round(time_s * 1e9)} ns" in reading.refusals.last


@pytest.mark.parametrize("name", ["", "Probe", "AToBToC", "Stylus Tip ToTracker", "../ToTracker"])
def test_name_without_frames_is_refused(reading, name):
    assert reading.read(name=name, matrix=POSE) == []
    assert reading.refusals.counts == {"FrameError": 1}


def test_body_of_wrong_length_is_refused(reading):
    short = message("STRING", "AToB", string="x")
    short._message_type = "TDATA"
    stream = MessageStream(TYPES, reading.refusals)
    [read] = stream.feed(short.pack())
    assert reading.poses.read(read) == []
    assert reading.refusals.counts == {"IgtlContentError": 1}


def test_number_of_transforms_is_limited(reading):
    for index in range(MAX_EDGES + 10):
        reading.read(name=f"S{index}ToTracker", matrix=POSE)
    assert reading.refusals.counts == {"IgtlLimitError": 10}
    [sample] = reading.read(name="S0ToTracker", matrix=POSE)
    assert sample.source == "s0"
