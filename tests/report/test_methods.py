"""The methods of a report: digests of the files that it was made of."""

import hashlib

import yaml

from app.case import open_case
from app.cli.main import main
from app.report.methods import input_digests
from tests.cli.small_case import write_small_case


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def write_folder_case(folder):
    """A case whose recording is a folder, as `marginguard record` and a session write it."""
    assert main(["convert", str(write_small_case(folder / "made")), str(folder / "case")]) == 0
    case = folder / "case"
    (case / "bag").mkdir()
    manifest = yaml.safe_load((case / "case.yaml").read_text())
    (case / manifest["recording"]["path"]).rename(case / "bag" / "bag_0.mcap")
    manifest["recording"] = {"path": "bag"}
    (case / "case.yaml").write_text(yaml.safe_dump(manifest))
    return case


def meshes_of(case):
    manifest = yaml.safe_load((case / "case.yaml").read_text())
    return [manifest[owner]["mesh"]["path"] for owner in ("tumor", "tool")]


def test_recording_that_is_a_folder_has_the_digest_of_each_file(tmp_path):
    case = write_folder_case(tmp_path)
    expected = {
        "case.yaml": digest(case / "case.yaml"),
        "bag/bag_0.mcap": digest(case / "bag" / "bag_0.mcap"),
        **{name: digest(case / name) for name in meshes_of(case)},
    }
    assert len(expected) == 4
    assert input_digests(open_case(case)) == expected
