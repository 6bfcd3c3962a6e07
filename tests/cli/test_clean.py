"""``marginguard doctor clean`` removes the caches of this installation and nothing else."""

import shutil

import pytest

from app.cli import caches
from tests.cli.command import refused, run, run_json
from tests.forking import run_forked

pytestmark = pytest.mark.slow

FIELD = "0" * 64 + ".field"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The cache of fields of a new user, with two files; no kernels are compiled."""
    folder = tmp_path / "home" / ".cache" / "marginguard"
    folder.mkdir(parents=True)
    (folder / FIELD).write_bytes(b"x" * 1000)
    (folder / "abc.part").write_bytes(b"x" * 10)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(caches, "_kernel_folders", lambda: iter(()))
    return folder


@pytest.mark.parametrize("option", [[], ["--dry-run"]])
def test_nothing_is_removed_without_yes(folder, option):
    (found,) = run_json("doctor", "clean", *option)
    sizes = {"files": 2, "bytes": 1010, "problem": ""}
    assert found == {"kind": "distance fields", "folder": str(folder), **sizes}
    assert len(list(folder.iterdir())) == 2


def test_yes_removes_the_files_and_the_empty_folder(folder):
    assert run("doctor", "clean", "--yes").out.splitlines()[-1].endswith(" 2 files  removed")
    assert not folder.exists()
    assert run("doctor", "clean").out.split()[:3] == ["0.0", "MB", "0"]


def test_other_files_folders_and_links_stay(folder, tmp_path):
    outside = tmp_path / "outside.field"
    outside.write_text("not ours")
    (folder / "notes.txt").write_text("a user's")
    (folder / "link.field").symlink_to(outside)
    (folder / "deep.field").mkdir()
    (folder / "deep.field" / FIELD).write_text("below a folder")
    assert [found["files"] for found in run_json("doctor", "clean", "--yes")] == [2]
    assert {path.name for path in folder.iterdir()} == {"notes.txt", "link.field", "deep.field"}
    assert outside.read_text() == "not ours"
    assert (folder / "deep.field" / FIELD).exists()


def test_linked_cache_folder_is_reported_and_not_followed(folder, tmp_path):
    elsewhere = tmp_path / "elsewhere"
    shutil.move(folder, elsewhere)
    folder.symlink_to(elsewhere)
    (found,) = run_json("doctor", "clean", "--yes", status=1)
    assert (found["files"], found["problem"]) == (0, "a symbolic link, which is not followed")
    assert (elsewhere / FIELD).exists()
    assert folder.is_symlink()


def test_folder_that_cannot_be_read_is_a_problem(folder):
    shutil.rmtree(folder)
    folder.write_text("a file instead of the folder")
    assert run_json("doctor", "clean", "--yes", status=1)[0]["problem"] == "Not a directory"
    assert folder.exists()


def test_yes_and_dry_run_contradict_each_other():
    assert "not allowed with" in refused("doctor", "clean", "--yes", "--dry-run")


PROGRAM = """
import sys
from numba.core.config import reload_config

reload_config()  # numba was imported before, without this variable
from app.cli.caches import cache_folders, visit
from app.robot.link_kernel import compute_link_poses

compute_link_poses.compile(
    "b1(f8[::1], b1[::1], f8[:, :, ::1], f8[:, :, :, ::1], i8[::1], f8[:, :, ::1])"
)
# Only below the given folder: other tests use the kernels beside the sources.
found = [folder for folder in cache_folders() if str(folder.path).startswith(sys.argv[1])]
print(max(visit(folder, removing=True).count for folder in found))
"""


def test_kernels_are_found_where_numba_writes_them(project_root, tmp_path):
    own = {"NUMBA_CACHE_DIR": str(tmp_path)}
    done = run_forked("-c", PROGRAM, tmp_path, folder=project_root, environment=own)
    assert done.stdout == "2\n", done.stderr  # an index and one compiled function
    assert list(tmp_path.iterdir()) == []
