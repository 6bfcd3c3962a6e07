"""Files and folders that appear complete or not at all; lines that survive a damaged end."""

import errno
import json
import os
import stat
from pathlib import Path

import pytest

from app.files.atomic_io import atomic_file, check_output_path, new_folder, write_file, write_files
from app.files.json_file import JsonLinesFile
from app.geometry import InputError, MeshError


def fill(folder: Path, error: BaseException | None = None) -> None:
    with new_folder(folder) as partial:
        (partial / "file").write_text("half")
        if error is not None:
            raise error


def test_folder_appears_when_it_is_complete(tmp_path):
    with new_folder(tmp_path / "a" / "new") as partial:
        (partial / "file").write_text("whole")
        assert not (tmp_path / "a" / "new").exists()
    assert (tmp_path / "a" / "new" / "file").read_text() == "whole"
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["new"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_failed_folder_leaves_nothing(tmp_path, error):
    with pytest.raises(error):
        fill(tmp_path / "new", error())
    assert list(tmp_path.iterdir()) == []


def test_full_disk_is_reported_with_the_folder(tmp_path):
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    with pytest.raises(InputError, match=r"new cannot be written: .*No space left"):
        fill(tmp_path / "new", full)
    assert list(tmp_path.iterdir()) == []


def test_existing_paths_are_not_touched(tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to("nowhere")
    for name in ("folder", "file", "link"):
        with pytest.raises(InputError, match=f"{name} already exists; refusing to overwrite it"):
            fill(tmp_path / name)
    with pytest.raises(InputError, match="new cannot be written: Not a directory"):
        fill(tmp_path / "file" / "new")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder", "link"]


def test_empty_folder_is_replaced_only_when_allowed(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="empty already exists"):
        fill(tmp_path / "empty")
    with new_folder(tmp_path / "empty", may_be_empty=True) as partial:
        (partial / "file").write_text("whole")
    assert (tmp_path / "empty" / "file").read_text() == "whole"
    with pytest.raises(InputError, match="expected a new or an empty folder"):
        new_folder(tmp_path / "empty", may_be_empty=True).__enter__()


def test_failed_write_keeps_the_earlier_file(tmp_path):
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


def test_written_file_has_the_permissions_of_any_new_file(tmp_path):
    (tmp_path / "plain").write_bytes(b"")
    write_file(tmp_path / "atomic", b"")
    with new_folder(tmp_path / "folder"):
        pass
    (tmp_path / "plain folder").mkdir()
    for made, plain in (("atomic", "plain"), ("folder", "plain folder")):
        assert (tmp_path / made).stat().st_mode == (tmp_path / plain).stat().st_mode


def test_no_file_is_replaced_before_all_are_written(tmp_path):
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
def test_unusable_output_path_is_refused(tmp_path, name, message):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    check_output_path(tmp_path / "file")
    with pytest.raises(InputError, match=message):
        check_output_path(tmp_path / name)
    with pytest.raises(InputError, match="cannot be written"):
        write_file(tmp_path / name, b"")


def lines(path):
    return [json.loads(line) for line in path.read_text().splitlines() if line]


def test_lines_are_appended_to_those_of_an_earlier_run(tmp_path):
    path = tmp_path / "new" / "log.jsonl"
    for run in range(2):
        with JsonLinesFile(path) as file:
            file.append({"run": run})
            assert lines(path)[-1] == {"run": run}
    assert lines(path) == [{"run": 0}, {"run": 1}]
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_line_that_a_crash_has_cut_off_damages_no_other(tmp_path):
    path = tmp_path / "log.jsonl"
    path.write_text('{"run":0}\n{"ru')
    with JsonLinesFile(path) as file:
        file.append({"run": 1})
    assert path.read_text() == '{"run":0}\n{"ru\n{"run":1}\n'


def test_full_file_is_renamed_and_the_oldest_one_removed(tmp_path):
    path = tmp_path / "log.jsonl"
    with JsonLinesFile(path, max_bytes=25, kept=2) as file:
        for number in range(10):
            file.append({"number": number})  # 13 bytes: one line a file
    numbers = {each.name: lines(each)[0]["number"] for each in tmp_path.iterdir()}
    assert numbers == {"log.jsonl": 9, "log.jsonl.1": 8, "log.jsonl.2": 7}


def numbers(folder):
    return {each.name: [line["number"] for line in lines(each)] for each in folder.iterdir()}


@pytest.mark.parametrize("code", [errno.EMFILE, errno.ENOSPC])
def test_file_that_cannot_be_replaced_is_continued_and_keeps_the_earlier_ones(
    tmp_path, monkeypatch, code
):
    def fail(*_):
        raise OSError(code, os.strerror(code))

    path, other = tmp_path / "logs" / "log.jsonl", tmp_path / "other"
    with JsonLinesFile(path, max_bytes=25, kept=2) as file:
        for number in range(3):
            file.append({"number": number})
        with monkeypatch.context() as patch:
            patch.setattr(os, "open", fail)
            for number in range(3, 6):
                with other.open("w"):  # takes each descriptor that is free
                    file.append({"number": number})
        assert numbers(path.parent) == {
            "log.jsonl": [2, 3, 4, 5],
            "log.jsonl.1": [1],
            "log.jsonl.2": [0],
        }
        file.append({"number": 6})
    assert other.read_text() == ""
    assert numbers(path.parent) == {
        "log.jsonl": [6],
        "log.jsonl.1": [2, 3, 4, 5],
        "log.jsonl.2": [1],
    }


def test_removed_file_moves_no_earlier_one(tmp_path):
    path = tmp_path / "log.jsonl"
    with JsonLinesFile(path, max_bytes=25, kept=2) as file:
        for number in range(3):
            file.append({"number": number})
        path.unlink()
        file.append({"number": 3})
    assert numbers(tmp_path) == {"log.jsonl": [3], "log.jsonl.1": [1], "log.jsonl.2": [0]}


@pytest.mark.parametrize("make", [lambda path: path.mkdir(), os.mkfifo])
def test_anything_but_a_regular_file_is_refused(tmp_path, make):
    path = tmp_path / "log.jsonl"
    make(path)
    with pytest.raises(InputError, match="not a regular file"):
        JsonLinesFile(path)


def test_folder_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        JsonLinesFile(tmp_path / "file" / "log.jsonl")
