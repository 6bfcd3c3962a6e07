"""``marginguard replay`` in real time, heard by another DDS implementation while it runs."""

import os
import subprocess
import sys

import pytest

from app.case import open_case

SAMPLES = 100


@pytest.fixture
def case_folder(project_root):
    return project_root / "data" / "recorded_case"


@pytest.fixture
def replay(domain_id, case_folder, project_root, tmp_path):
    """The command, playing at the pace of the recording; ended at the latest with the test."""
    log_file = tmp_path / "replay.log"
    with log_file.open("w") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "app.cli", "replay", str(case_folder), "--rate", "1"],
            cwd=project_root,
            stdout=log,
            stderr=log,
            env=dict(os.environ),
        )
    yield process
    process.kill()
    process.wait()
    print(log_file.read_text())  # shown when the test fails


def recorded_stamps(case_folder):
    """Every acquisition stamp of the recording, by child frame; those of the joints as ``None``."""
    stamps = {}
    for frame in open_case(case_folder).frames():
        for sample in frame.poses:
            stamps.setdefault(sample.source, set()).add(sample.stamp.ns)
        for joints in frame.joints:
            stamps.setdefault(None, set()).add(joints.stamp.ns)
    return stamps


def test_cyclone_dds_hears_the_virtual_fixture_with_source_stamps(
    replay, case_folder, start_cyclone, tmp_path
):
    lines = start_cyclone("virtual_fixture", str(SAMPLES), wait=False).messages()
    assert replay.poll() is None, "the replay was still running"
    replay.terminate()
    assert replay.wait(60) == 143
    assert "Traceback" not in (tmp_path / "replay.log").read_text()

    recorded = recorded_stamps(case_folder)
    anything = set().union(*recorded.values())
    heard = {}
    for line in lines:
        heard.setdefault((line["parent"], line["child"]), []).append(line["stamp_ns"])
    for (_, child), stamps in heard.items():
        assert stamps == sorted(set(stamps)), f"{child}: each sample once, in order"
        if child == "virtual_fixture":
            assert set(stamps) <= anything
        else:
            assert set(stamps) <= recorded.get(child, recorded[None]), child
    fixture = heard["tumor", "virtual_fixture"]
    assert len(fixture) >= SAMPLES
    # At the pace of the recording: the stamps of 100 samples at 50 Hz are some 2 s apart.
    assert 1.5e9 < fixture[SAMPLES - 1] - fixture[0] < 60e9
    assert ("tracker", "cautery") in heard
    links = [child for parent, child in heard if child not in recorded and parent != "tumor"]
    assert len(links) >= 6
    for line in lines:
        assert abs(sum(value**2 for value in line["rotation"]) - 1.0) < 1e-9
        assert max(abs(value) for value in line["translation"]) < 5.0, "metres, not millimetres"
