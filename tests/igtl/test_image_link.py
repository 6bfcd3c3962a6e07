"""Images over a connection: a server of pyigtl, and what the command sends and receives."""

import json
import socket
import threading

import numpy as np
import pyigtl
import pytest

from app.cli.main import build_parser, main
from app.igtl.framing import IgtlError, Refusals
from app.igtl.image_messages import receive_images, send_images
from tests.case.images.sequences import CALIBRATION, frame_fields, some_pixels, write_metafile


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as found:
        return int(found.getsockname()[1])


def test_images_of_a_pyigtl_message_are_received_from_a_server():
    values = some_pixels(1, 30, 40)[0]
    packet = pyigtl.ImageMessage(
        values[None], np.eye(4), "ras", timestamp=2.5, device_name="Image"
    ).pack()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        sending = threading.Thread(
            target=send_images,
            args=(listener, [(0, packet), (0, packet)]),
            kwargs={"sleep_s": lambda seconds: None},
        )
        sending.start()
        refusals = Refusals()
        found = list(receive_images("127.0.0.1", listener.getsockname()[1], refusals))
        sending.join()
    assert not refusals.counts
    for image in found:
        np.testing.assert_array_equal(image.image.pixels, values)
    assert [image.image.number for image in found] == [0, 1]


def test_missing_server_is_one_line():
    port = free_port()
    with pytest.raises(IgtlError, match=rf"127\.0\.0\.1:{port}: .*; expected a server"):
        next(receive_images("127.0.0.1", port, Refusals()))


def test_command_sends_a_recording_that_the_command_receives(tmp_path, capsys):
    fields = frame_fields(
        4,
        Seq_Frame0001_ImageStatus="INVALID",
        Seq_Frame0002_ProbeToTrackerTransformStatus="MISSING",
    )
    for n in range(4):  # 1 ms apart
        fields[f"Seq_Frame{n:04d}_Timestamp"] = f"{100 + 0.001 * n:.6f}"
    path = write_metafile(tmp_path / "x.igs.mha", some_pixels(4), fields=fields)
    matrix = np.vstack([CALIBRATION, (0, 0, 0, 1)])
    (tmp_path / "c.txt").write_text(" ".join(map(str, matrix.ravel())))
    shown = ["info", "images", str(path), "--calibration", str(tmp_path / "c.txt")]
    assert main([*shown, "--json"]) == 0
    expected = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    port = free_port()
    options = build_parser().parse_args([*shown, "--serve", str(port)])
    sending = threading.Thread(target=options.run, args=(options,))
    sending.start()
    status = 2
    while status == 2:  # until the server listens
        status = main(["info", "images", f"igtl://127.0.0.1:{port}", "--json"])
    sending.join()
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("{")]
    found = [json.loads(line) for line in lines]
    sent = [expected[0], expected[3]]  # an image that is invalid or has no place is not sent
    assert [each["sha256"] for each in found] == [each["sha256"] for each in sent]
    assert [each["stamp_ns"] for each in found] == [each["stamp_ns"] for each in sent]
    for mine, theirs in zip(found, sent, strict=True):
        np.testing.assert_allclose(mine["corners_mm"], theirs["corners_mm"], atol=1e-3)
