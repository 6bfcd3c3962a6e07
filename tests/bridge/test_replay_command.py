"""``marginguard replay`` in real time, received by another DDS implementation."""

import signal

import pytest

from app.case import open_case
from tests.cut_case import write_cut_case

pytestmark = pytest.mark.slow

SAMPLES = 40


@pytest.fixture
def case_folder(tmp_path):
    """More of the shipped case than is played."""
    return write_cut_case(tmp_path / "case", 0.0, 30.0)


def recorded_stamps(case_folder):
    """Acquisition stamps of the recording by child frame; those of joint states under ``None``."""
    stamps = {}
    for frame in open_case(case_folder).frames():
        for sample in frame.poses:
            stamps.setdefault(sample.source, set()).add(sample.stamp.ns)
        for joints in frame.joints:
            stamps.setdefault(None, set()).add(joints.stamp.ns)
    return stamps


def test_cyclone_dds_receives_the_virtual_fixture_with_source_stamps(
    start, case_folder, start_cyclone
):
    replay = start("-m", "app.cli", "replay", case_folder, "--rate", "1")
    lines = start_cyclone("virtual_fixture", str(SAMPLES), wait=False).messages()
    assert replay.process.poll() is None, "the replay was still running"
    replay.stop(signal.SIGTERM)

    recorded = recorded_stamps(case_folder)
    all_stamps = set().union(*recorded.values())
    received = {}
    for line in lines:
        received.setdefault((line["parent"], line["child"]), []).append(line["stamp_ns"])
    for (_, child), stamps in received.items():
        assert stamps == sorted(set(stamps)), f"{child}: each sample once, in order"
        if child == "virtual_fixture":
            assert set(stamps) <= all_stamps
        else:
            assert set(stamps) <= recorded.get(child, recorded[None]), child
    fixture = received["tumor", "virtual_fixture"]
    assert len(fixture) >= SAMPLES
    # At the rate of the recording 40 samples at 50 Hz span about 0.8 s.
    assert 0.6e9 < fixture[SAMPLES - 1] - fixture[0] < 60e9
    assert ("tracker", "cautery") in received
    links = [child for parent, child in received if child not in recorded and parent != "tumor"]
    assert len(links) >= 6
    for line in lines:
        assert abs(sum(value**2 for value in line["rotation"]) - 1.0) < 1e-9
        assert max(abs(value) for value in line["translation"]) < 5.0, "metres, not millimetres"
