"""Only regular files are read, at once, up to a bound."""

import os
import socket
from pathlib import Path

import pytest

from app.files.bounded_io import check_regular, is_file, is_folder, read_bounded
from app.geometry import InputError, MeshError


def test_file_is_read_up_to_its_bound(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    assert read_bounded(path, 5) == b"12345"
    with pytest.raises(MeshError, match=r"/a has more than the 4 bytes allowed"):
        read_bounded(path, 4, MeshError)


def test_pipe_without_writer_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="it is a pipe; expected a regular file"):
        read_bounded(tmp_path / "pipe", 100)


def test_link_to_a_pipe_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to(tmp_path / "pipe")
    with pytest.raises(InputError, match="it is a pipe"):
        check_regular(tmp_path / "link")


def test_folder_device_and_socket_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="it is a folder; expected a regular file"):
        check_regular(tmp_path)
    with pytest.raises(InputError, match="it is a device"):
        check_regular(Path("/dev/zero"))
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / "socket"))
        with pytest.raises(InputError, match="cannot be read"):
            check_regular(tmp_path / "socket")


@pytest.mark.parametrize("name", ["a" * 300, "a" * 100_000, "a\0b", "missing", "loop"])
def test_name_of_no_file_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    with pytest.raises(InputError, match="cannot be read") as caught:
        read_bounded(tmp_path / name, 100)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 2000
    assert not is_file(tmp_path / name)
    assert not is_folder(tmp_path / name)


def test_no_descriptor_stays_open_after_a_refusal(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    before = len(list(Path("/proc/self/fd").iterdir()))
    for _ in range(5):
        with pytest.raises(InputError):
            check_regular(tmp_path / "pipe")
    assert len(list(Path("/proc/self/fd").iterdir())) == before
