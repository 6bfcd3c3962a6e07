"""The results of the cases in a folder: computed once for each content, and kept."""

import threading
from contextlib import contextmanager

import pytest

from app.geometry import InputError
from app.viewer.case_library import CaseLibrary, CaseResult
from tests.waiting import DEADLINE_S, wait_until


class Replays:
    """TEST DOUBLE of the replays: counts them; a case without a recording is refused."""

    def __init__(self):
        self.replayed: list[str] = []

    def result(self, folder):
        self.replayed.append(folder.name)
        if not (folder / "recording").is_file():
            raise InputError("recording: no such\nfile")
        text = (folder / "recording").read_text()
        return CaseResult({"name": text, "breaches": len(text)}, b"PNG" if text else None)


def write_case(root, name, recording):
    folder = root / name
    folder.mkdir(parents=True)
    (folder / "case.yaml").write_text("schema: 1\n")
    if recording is not None:
        (folder / "recording").write_text(recording)
    return folder


@contextmanager
def opened(root, cache, replays, version="1"):
    library = CaseLibrary(root, cache, replays.result, version)
    library.start()
    yield library
    library.close()


def wait(library, done):
    """Wait until the rows, by their folders, are ``done``."""
    wait_until(
        lambda: done({str(row["folder"]): row for row in library.rows()}), describe=library.rows
    )


def all_done(rows):
    return all(row["state"] != "computing" for row in rows.values())


def test_each_content_is_replayed_once(tmp_path):
    root, cache, replays = tmp_path / "cases", tmp_path / "cache", Replays()
    first = write_case(root, "first", "one")
    write_case(root, "second", "seven")
    write_case(root, "broken", None)
    write_case(root, ".hidden", "x")
    (root / "no_case").mkdir()
    (root / "link").symlink_to(first)
    with opened(root, cache, replays) as library:
        wait(library, all_done)
        rows = {str(row["folder"]): row for row in library.rows()}
        assert rows.keys() == {"first", "second", "broken"}
        assert (rows["first"]["name"], rows["first"]["breaches"]) == ("one", 3)
        assert rows["broken"]["state"] == "failed"
        assert rows["broken"]["problem"] == "recording: no such file"
        assert library.picture("first") == b"PNG"
        assert library.picture("broken") is None and library.picture("other") is None
        assert library.folder("second") == root / "second"
        for name in ("other", "../first", "link", ""):
            with pytest.raises(InputError, match="not in the library"):
                library.folder(name)
    assert sorted(replays.replayed) == ["broken", "first", "second"]
    assert cache.stat().st_mode & 0o077 == 0
    again = Replays()
    with opened(root, cache, again) as library:
        wait(library, all_done)
        assert library.picture("first") == b"PNG"
    assert again.replayed == ["broken"]  # a failure is not kept
    other = Replays()
    with opened(root, cache, other, "2") as library:
        wait(library, all_done)
    assert sorted(other.replayed) == ["broken", "first", "second"]


def test_changed_new_and_removed_cases_are_found(tmp_path):
    root, replays = tmp_path / "cases", Replays()
    first = write_case(root, "first", "one")
    with opened(root, tmp_path / "cache", replays) as library:
        wait(library, all_done)
        (first / "recording").write_text("longer")
        write_case(root, "new", "")
        library.refresh()
        wait(library, lambda rows: all_done(rows) and rows["first"].get("breaches") == 6)
        assert sorted(replays.replayed) == ["first", "first", "new"]
        (first / "case.yaml").unlink()
        library.refresh()
        assert [row["folder"] for row in library.rows()] == ["new"]


def test_damaged_cache_is_computed_again(tmp_path):
    root, cache = tmp_path / "cases", tmp_path / "cache"
    write_case(root, "first", "one")
    with opened(root, cache, Replays()) as library:
        wait(library, all_done)
    for text in ("{", "[]", ""):
        (path,) = cache.glob("*.json")
        path.write_text(text)
        replays = Replays()
        with opened(root, cache, replays) as library:
            wait(library, all_done)
            assert library.rows()[0]["breaches"] == 3
        assert replays.replayed == ["first"]


def test_case_that_cannot_be_replayed_is_refused_before_it_is_listed(tmp_path):
    root, replays = tmp_path / "cases", Replays()
    root.mkdir()
    with opened(root, tmp_path / "cache", replays) as library:
        with pytest.raises(InputError, match="recording: no such"):
            library.checked(write_case(tmp_path, "broken", None))
        sound = write_case(tmp_path, "sound", "one")
        library.checked(sound)
        sound.rename(root / "sound")
        library.refresh()
        wait(library, all_done)
    assert replays.replayed == ["broken", "sound"]


def test_missing_folder_is_refused(tmp_path):
    with pytest.raises(InputError, match="expected a folder of cases"):
        CaseLibrary(tmp_path / "no", tmp_path, Replays().result, "1").start()


def test_closed_library_ends_its_thread(tmp_path):
    with opened(tmp_path, tmp_path / "cache", Replays()):
        (thread,) = [each for each in threading.enumerate() if each.name == "case library"][-1:]
    thread.join(DEADLINE_S)
    assert not thread.is_alive()
