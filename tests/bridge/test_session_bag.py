"""``marginguard replay --mcap``: the bag read by mcap and by rosbags."""

import math
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from app.cli.bag_writing import BagProcess, bag_of
from app.cli.main import main
from app.geometry import SurfaceMesh
from app.runtime import PreparedCase, ReplayRun, prepare_case
from tests.cli.small_case import FRAMES, write_small_case

pytestmark = pytest.mark.slow

CONSTRAINT = "/marginguard/constraint"
MARGIN_MM = "/marginguard/margin_mm"
MARKERS = "/marginguard/markers"


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_small_case(tmp_path_factory.mktemp("bag") / "case")


@pytest.fixture(scope="module")
def prepared(case: Path) -> PreparedCase:
    return prepare_case(case)


@pytest.fixture(scope="module")
def bag(case: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bags") / "results"
    assert main(["replay", str(case), "--no-ros", "--mcap", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def messages(bag: Path) -> list[tuple[str, int, object]]:
    return decoded(bag)


def decoded(folder: Path) -> list[tuple[str, int, object]]:
    """Topic, time in ns and message, by the definitions that the bag contains."""
    with Reader(folder) as reader:
        store = get_typestore(Stores.EMPTY)
        for connection in reader.connections:
            store.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
        return [
            (connection.topic, time_ns, store.deserialize_cdr(data, connection.msgtype))
            for connection, time_ns, data in reader.messages()
        ]


def test_rosbags_reads_the_distances_of_the_replay(prepared, messages):
    distances = [message.data for topic, _, message in messages if topic == MARGIN_MM]
    constraints = [message for topic, _, message in messages if topic == CONSTRAINT]
    assert len(distances) == FRAMES
    assert len(constraints) == FRAMES + 1  # the last one is on hold
    assert constraints[-1].hold
    assert [each.seq for each in constraints] == list(range(FRAMES + 1))
    replay = ReplayRun(prepared, clock_ns=time.monotonic_ns)
    expected = [step.decision.proximity.signed_distance_mm for step in replay.steps()]
    assert distances == pytest.approx(expected)
    for distance, constraint in zip(distances, constraints, strict=False):
        assert constraint.signed_distance * 1000.0 == pytest.approx(distance, nan_ok=True)
        assert constraint.simulated
        assert math.isnan(distance) == (constraint.state == 3)
    surfaces = [
        marker.ns
        for topic, _, message in messages
        if topic == MARKERS
        for marker in message.markers
    ]
    assert {"tumor", "tool", "margin"} == set(surfaces)


def test_times_are_those_of_the_frames(bag, messages):
    times = [time_ns for topic, time_ns, _ in messages if topic == MARGIN_MM]
    assert {after - before for before, after in pairwise(times)} == {50_000_000}
    with next(bag.glob("*.mcap")).open("rb") as file:
        reader = make_reader(file)
        found = list(reader.iter_messages(topics=["/tf_static", "/tf"]))
        assert reader.get_summary().statistics.message_count > 4 * FRAMES
    assert min(message.log_time for _, _, message in found) == times[0]
    schema, channel, _ = found[0]
    assert (schema.name, channel.message_encoding) == ("tf2_msgs/msg/TFMessage", "cdr")
    assert channel.metadata["topic_type_hash"].startswith("RIHS01_")


def test_an_existing_folder_is_not_overwritten(case, tmp_path, capsys):
    (tmp_path / "mine").write_text("kept")
    assert main(["replay", str(case), "--no-ros", "--mcap", str(tmp_path)]) == 2
    assert "already exists" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


@pytest.mark.parametrize(
    ("folder", "is_killed", "problem"),
    [
        ("bag", True, "ended with status -9"),
        ("file/bag", False, "bag cannot be written: Not a directory"),
    ],
)
def test_a_bag_that_fails_is_not_kept(
    case, tmp_path, capsys, monkeypatch, folder, is_killed, problem
):
    begin = BagProcess.begin

    def begin_and_fail(self: BagProcess, run: ReplayRun, path: Path) -> None:
        path.parent.joinpath("file").write_text("")
        begin(self, run, path.parent / folder)
        if is_killed:
            self._process.kill()

    monkeypatch.setattr(BagProcess, "begin", begin_and_fail)
    assert main(["replay", str(case), "--no-ros", "--mcap", str(tmp_path / "bag")]) == 2
    assert problem in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_replay_that_was_stopped_leaves_no_bag(prepared, tmp_path):
    replay = ReplayRun(prepared, clock_ns=time.monotonic_ns)
    with BagProcess() as bag, bag_of(bag, replay, tmp_path / "bag", lambda: False):
        next(replay.steps())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("other_tumor", [False, True])
def test_a_change_of_the_content_is_in_the_bag(case, messages, tmp_path, other_tumor):
    prepared = prepare_case(case)  # a distance depends a little on the queries before it
    content = prepared.content
    if other_tumor:
        vertices = content.tumor.vertices_mm + 0.5
        tumor = SurfaceMesh(content.tumor.frame, vertices, content.tumor.faces)
        content = replace(content, tumor=tumor)
    replay = ReplayRun(prepared, clock_ns=time.monotonic_ns)
    with BagProcess() as process, bag_of(process, replay, tmp_path / "bag", lambda: True):
        for number, _ in enumerate(replay.steps()):
            if number == 9:
                process.prepare(content)(content)
    before, after = messages, decoded(tmp_path / "bag")
    # Another tumour makes the margin UNKNOWN at once; equal surfaces are not new.
    unknown = [topic for topic, _, message in after if topic == CONSTRAINT and message.state == 3]
    known = [topic for topic, _, message in before if topic == CONSTRAINT and message.state == 3]
    assert len(unknown) - len(known) == other_tumor
    if other_tumor:
        assert len(after) != len(before)
    else:  # the same case gives the same messages
        for one, other in zip(before, after, strict=True):
            assert repr(one) == repr(other)
