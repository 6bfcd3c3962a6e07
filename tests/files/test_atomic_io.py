"""A folder that appears whole or not at all."""

import errno
import os
from pathlib import Path

import pytest

from app.files.atomic_io import new_folder
from app.geometry import InputError


def fill(folder: Path, error: BaseException | None = None) -> None:
    with new_folder(folder) as partial:
        (partial / "file").write_text("half")
        if error is not None:
            raise error


def test_it_appears_with_all_that_was_written(tmp_path: Path) -> None:
    with new_folder(tmp_path / "a" / "new") as partial:
        (partial / "file").write_text("whole")
        assert not (tmp_path / "a" / "new").exists()
    assert (tmp_path / "a" / "new" / "file").read_text() == "whole"
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["new"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_nothing_stays_of_one_that_could_not_be_filled(
    tmp_path: Path, error: type[BaseException]
) -> None:
    with pytest.raises(error):
        fill(tmp_path / "new", error())
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_said_of_the_folder(tmp_path: Path) -> None:
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    with pytest.raises(InputError, match=r"new cannot be written: .*No space left"):
        fill(tmp_path / "new", full)
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to("nowhere")
    for name in ("folder", "file", "link"):
        with pytest.raises(InputError, match=f"{name} already exists; refusing to overwrite it"):
            fill(tmp_path / name)
    with pytest.raises(InputError, match="new cannot be written: Not a directory"):
        fill(tmp_path / "file" / "new")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder", "link"]
