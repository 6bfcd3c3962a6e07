from pathlib import Path

import pytest

from app.case import open_case, open_live, read_recording, recover_recording
from app.geometry import InputError


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
