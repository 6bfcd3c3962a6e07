"""Folders and files that appear complete or not at all."""

import errno
import os
from pathlib import Path

import pytest

from app.files.atomic_io import (
    atomic_file,
    check_output_path,
    new_folder,
    write_file,
    write_files,
)
from app.geometry import InputError, MeshError


def fill(folder: Path, error: BaseException | None = None) -> None:
    with new_folder(folder) as partial:
        (partial / "file").write_text("half")
        if error is not None:
            raise error


def test_folder_appears_when_it_is_complete(tmp_path: Path) -> None:
    with new_folder(tmp_path / "a" / "new") as partial:
        (partial / "file").write_text("whole")
        assert not (tmp_path / "a" / "new").exists()
    assert (tmp_path / "a" / "new" / "file").read_text() == "whole"
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["new"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_failed_folder_leaves_nothing(tmp_path: Path, error: type[BaseException]) -> None:
    with pytest.raises(error):
        fill(tmp_path / "new", error())
    assert list(tmp_path.iterdir()) == []


def test_full_disk_is_reported_with_the_folder(tmp_path: Path) -> None:
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    with pytest.raises(InputError, match=r"new cannot be written: .*No space left"):
        fill(tmp_path / "new", full)
    assert list(tmp_path.iterdir()) == []


def test_existing_paths_are_not_touched(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to("nowhere")
    for name in ("folder", "file", "link"):
        with pytest.raises(InputError, match=f"{name} already exists; refusing to overwrite it"):
            fill(tmp_path / name)
    with pytest.raises(InputError, match="new cannot be written: Not a directory"):
        fill(tmp_path / "file" / "new")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder", "link"]


def test_empty_folder_is_replaced_only_when_allowed(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="empty already exists"):
        fill(tmp_path / "empty")
    with new_folder(tmp_path / "empty", may_be_empty=True) as partial:
        (partial / "file").write_text("whole")
    assert (tmp_path / "empty" / "file").read_text() == "whole"
    with pytest.raises(InputError, match="expected a new or an empty folder"):
        new_folder(tmp_path / "empty", may_be_empty=True).__enter__()


def test_failed_write_keeps_the_earlier_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    write_file(path, b"old")
    write_file(path, b"new")
    with pytest.raises(MeshError, match="file cannot be written: No space left"):
        fail_to_write(path, OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
    with pytest.raises(KeyboardInterrupt):
        fail_to_write(path, KeyboardInterrupt())
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


def fail_to_write(path: Path, error: BaseException) -> None:
    with atomic_file(path, MeshError) as partial:
        partial.write_bytes(b"half")
        raise error


def test_written_file_has_the_permissions_of_any_new_file(tmp_path: Path) -> None:
    (tmp_path / "plain").write_bytes(b"")
    write_file(tmp_path / "atomic", b"")
    with new_folder(tmp_path / "folder"):
        pass
    (tmp_path / "plain folder").mkdir()
    for made, plain in (("atomic", "plain"), ("folder", "plain folder")):
        assert (tmp_path / made).stat().st_mode == (tmp_path / plain).stat().st_mode


def test_no_file_is_replaced_before_all_are_written(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "report"
    write_files(folder, {"a": b"1", "b": b"2"})
    with pytest.raises(TypeError):
        write_files(folder, {"a": b"3", "b": None})  # type: ignore[dict-item]
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == {"a": b"1", "b": b"2"}


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("folder", "folder cannot be written: is a directory"),
        ("none/file", "file cannot be written: parent directory does not exist"),
        ("file/file", "file cannot be written: parent directory does not exist"),
    ],
)
def test_unusable_output_path_is_refused(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    check_output_path(tmp_path / "file")
    with pytest.raises(InputError, match=message):
        check_output_path(tmp_path / name)
    with pytest.raises(InputError, match="cannot be written"):
        write_file(tmp_path / name, b"")
