"""Lines are complete on the disk, survive a damaged end, and files are rotated."""

import errno
import json
import os
import stat

import pytest

from app.files.json_lines import JsonLinesFile
from app.geometry import InputError


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
