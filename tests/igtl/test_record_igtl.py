"""``marginguard record`` of a session whose source is an OpenIGTLink server, images included."""

import json
import socket
import threading
from collections.abc import Iterator

import numpy as np
import pyigtl
import pytest
import yaml

from app.case import Activation, open_case, open_case_images
from app.geometry import TrackingStatus, join_transform_name
from benchmarks.images.session import POSES_MM, TOPIC, write_session
from tests.igtl.conftest import DEADLINE_S
from tests.oracles.pyigtl_peer import message

pytestmark = pytest.mark.long

FRAMES = 6
FIRST_S, STEP_S = 1_700_000_000.0, 0.125
SIZE = (4, 6)


def image(number: int) -> np.ndarray:
    """Pixels (rows, columns) of the image ``number``."""
    return np.random.default_rng(number).integers(0, 255, SIZE, np.uint8, endpoint=True)


def packets() -> Iterator[bytes]:
    """Messages of ``FRAMES`` frames as pyigtl encodes them; the rod is lost in the third."""
    for number in range(FRAMES):
        time_s = FIRST_S + number * STEP_S
        for frame, place in POSES_MM.items():
            matrix = np.eye(4)
            matrix[:3, 3] = np.array(place) + number
            status = "OUT_OF_VIEW" if (frame, number) == ("rod", 2) else "OK"
            yield message(
                name=join_transform_name(frame, "tracker"),
                matrix=matrix.tolist(),
                time_s=time_s,
                metadata={"TransformStatus": status},
            ).pack()
        text = "on" if number % 2 else "off"
        yield pyigtl.StringMessage(text, timestamp=time_s, device_name="Cautery").pack()
        yield pyigtl.ImageMessage(
            image(number)[None], np.eye(4), "ras", timestamp=time_s, device_name="Image_Reference"
        ).pack()


@pytest.fixture
def server() -> Iterator[int]:
    """Port of a server that sends all packets to its first client, and stays connected."""
    ended = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.settimeout(DEADLINE_S)

        def serve() -> None:
            client, _ = listening.accept()
            with client:
                for packet in packets():
                    client.sendall(packet)
                ended.wait(DEADLINE_S)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield listening.getsockname()[1]
        ended.set()
        thread.join()


def test_igtl_source_is_recorded_with_status_stamps_and_images(server, start, tmp_path):
    config = write_session(tmp_path / "session")
    values = yaml.safe_load(config.read_text())
    values["source"] = {"igtl": {"host": "127.0.0.1", "port": server}, "clock": "estimate"}
    del values["images"]["topic"]
    values["cautery"] = {"device": "Cautery", "stale_after_ms": 60_000}
    config.write_text(yaml.safe_dump(values))
    case = tmp_path / "case"
    arguments = ["record", "--json", "-o", str(case), "--config", str(config)]
    recorder = start("-m", "app.cli", *arguments)
    count = FRAMES * (len(POSES_MM) + 2)
    status = {"messages": 0}
    while status["messages"] < count:
        status = json.loads(recorder.line()).get("status", status)
    recorder.stop()
    assert status["topics"]["/tracked_transforms"] == FRAMES * len(POSES_MM)
    assert status["topics"]["/marginguard/images"] == FRAMES
    assert status["topics"]["/marginguard/cautery"] == FRAMES
    assert (status["lost"], status["problem"]) == ({}, "")
    assert TOPIC not in status["topics"]

    opened = open_case(case)
    found = [sample for frame in opened.recorded_frames() for sample in frame.poses]
    assert len(found) == FRAMES * len(POSES_MM)
    for sample in found:
        number = (sample.stamp.ns / 1e9 - FIRST_S) / STEP_S
        assert number == pytest.approx(round(number), abs=1e-4)  # 64-bit seconds
        if (sample.source, round(number)) == ("rod", 2):
            assert sample.status is not TrackingStatus.OK and sample.transform is None
            continue
        assert sample.status is TrackingStatus.OK and sample.transform is not None
        expected = np.array(POSES_MM[sample.source]) + round(number)
        assert sample.transform.translation_mm == pytest.approx(expected, abs=1e-9)
    # The last word is "on"; the words of one read come before its poses.
    assert [frame.activation for frame in opened.recorded_frames()][-1] is Activation.ON
    images = open_case_images(opened)
    assert images is not None and len(images) == FRAMES
    for number in range(FRAMES):
        shown = images.image(number)
        assert shown.pixels is not None and shown.stamp is not None
        np.testing.assert_array_equal(shown.pixels, image(number))
        assert shown.stamp.ns == pytest.approx((FIRST_S + number * STEP_S) * 1e9, rel=0, abs=1000)
