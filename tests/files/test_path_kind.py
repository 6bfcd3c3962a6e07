from pathlib import Path

import pytest

from app.case import open_case, open_live, read_recording, recover_recording
from app.files.path_kind import exists, is_file, is_folder
from app.geometry import InputError


def test_kind_of_a_path_that_the_file_system_cannot_hold_is_none(tmp_path: Path) -> None:
    for path in (tmp_path / ("a" * 100_000), tmp_path / "a\0b", tmp_path / "missing"):
        assert not (is_folder(path) or is_file(path) or exists(path))
    assert is_folder(tmp_path) and exists(tmp_path)
    (tmp_path / "file").touch()
    assert is_file(tmp_path / "file") and not is_folder(tmp_path / "file")


@pytest.mark.parametrize("name", ["a" * 100_000, "a" * 100_000 + ".mcap"])
def test_long_names_are_refused_in_one_line(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    for read in (
        lambda: open_case(path),
        lambda: open_live(path),
        lambda: list(read_recording(path, print)),
        lambda: recover_recording(path, tmp_path / "new.mcap"),
        lambda: recover_recording(tmp_path, path),
    ):
        with pytest.raises(InputError) as caught:
            read()
        assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []
