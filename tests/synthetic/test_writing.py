from pathlib import Path

import numpy as np
import pytest

from app.case import open_case
from app.geometry import InputError, MarginGuardError
from app.synthetic import simulate, simulate_case, simulate_unrecorded_case
from app.synthetic.case_options import CaseOptions
from app.synthetic.simulation import SENSOR_FROM_TUMOR, TOOL_FROM_TIP

pytestmark = pytest.mark.slow

SHORT = CaseOptions().with_values({"duration_s": 50.0})
FILES = {"case.yaml", "tracking.mcap", "tumor.stl", "cautery.stl", "expected.yaml", "README.md"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory, gantry):
    folder = tmp_path_factory.mktemp("simulated") / "case"
    simulate_case(folder, seed=1, arm=gantry, options=SHORT)
    return folder


@pytest.fixture(scope="module")
def simulation(gantry):
    return simulate(gantry, np.random.default_rng([1, 0]), SHORT)


@pytest.fixture(scope="module")
def case(folder):
    return open_case(folder)


def check_unrecorded(written: Path, kept: Path, **options: object) -> None:
    """A case without its recording has the frames and the other files of ``written``."""
    frames = simulate_unrecorded_case(kept, **options)
    assert {path.name for path in kept.iterdir()} == FILES - {"tracking.mcap"}
    read, other = open_case(written), open_case(kept, frames=frames)
    assert list(map(content, other.recorded_frames())) == list(map(content, read.recorded_frames()))
    assert sum(sample.transform is None for frame in frames for sample in frame.poses) > 10
    for name in FILES - {"tracking.mcap", "case.yaml"}:
        assert (kept / name).read_bytes() == (written / name).read_bytes(), name
    with pytest.raises(InputError, match="opened with frames"):
        other.with_joint_offset(0)


def test_same_seed_gives_an_unrecorded_case_the_frames_that_are_read_of_a_recording(
    folder, tmp_path, gantry
):
    """Equal frames have equal bytes: `tests/case/recorder`."""
    check_unrecorded(folder, tmp_path / "kept", seed=1, arm=gantry, options=SHORT)


def test_the_folder_holds_its_files_and_is_small(folder):
    assert {path.name for path in folder.iterdir()} == FILES
    assert list(folder.parent.iterdir()) == [folder]
    assert sum(path.stat().st_size for path in folder.iterdir()) < 5_000_000


def test_the_reader_reads_what_was_simulated(case):
    manifest = case.manifest
    assert manifest.provenance.kind == "simulated"
    assert manifest.clock.offset_robot_to_tracker_ns == 37_400_000
    assert manifest.tool.tool_from_tip.distance_mm_to(TOOL_FROM_TIP) < 1e-9
    assert manifest.tumor.frame_from_tumor.distance_mm_to(SENSOR_FROM_TUMOR) < 1e-9
    assert len(manifest.registration.dwells) == 8
    tumor = case.tumor_mesh().require_closed("tumor.stl")
    assert len(tumor.faces) >= 20_000
    case.tool_mesh().require_closed("cautery.stl")


def content(frame):
    """All of a frame, its numbers as bytes."""
    poses = [
        (each.target, each.source, each.stamp, each.status)
        if each.transform is None
        else (each.target, each.source, each.stamp, each.transform.matrix.tobytes())
        for each in frame.poses
    ]
    joints = [(each.names, each.positions, each.stamp) for each in frame.joints]
    return frame.stamp, poses, joints, frame.unfiltered_stamp, frame.activation


def test_every_frame_can_be_read_back(case):
    frames = list(case.frames())
    assert len(frames) == case.expected().frames
    assert sum(not frame.poses for frame in frames) == 1  # the watchdog frame of the gap
    assert frames[0].stamp.ns == 1_000_000_000_000


def test_expected_results_are_those_of_the_simulation(case, simulation):
    expected = case.expected()
    truth = simulation.reference_from_base
    assert expected.registration.reference_from_base.distance_mm_to(truth) < 1e-9
    assert [b.shaft_only for b in expected.breaches.intervals] == [False, False, True]
    assert len(expected.dropouts) == sum(len(d.frames) for d in simulation.scenario.dropouts)
    for breach in expected.breaches.intervals:
        middle = simulation.tumor_from_tip((breach.start_s + breach.end_s) / 2.0)
        assert simulation.clearance.height_mm(middle) < 0.0


def test_recorded_poses_are_close_to_the_expected_registration(case, simulation):
    """Averaged over a dwell, tip and joints agree with the registration."""
    frames = [frame for frame in case.frames() if frame.stamp.ns < 1_001_200_000_000]
    tips = []
    for frame in frames[3:]:
        poses = {sample.source: sample.transform for sample in frame.poses}
        reference_from_tip = poses["reference"].inverse() @ poses["cautery"] @ TOOL_FROM_TIP
        tips.append(reference_from_tip.translation_mm)
    by_arm = simulation.reference_from_base @ simulation.base_from_tip(0.5)
    assert np.linalg.norm(np.mean(tips, axis=0) - by_arm.translation_mm) < 0.4


@pytest.mark.parametrize("occupant", ["file", "full folder", "link"])
def test_existing_files_are_not_overwritten(tmp_path, gantry, occupant):
    folder = tmp_path / "case"
    if occupant == "file":
        folder.write_text("mine")
    elif occupant == "link":
        folder.symlink_to(tmp_path / "nowhere")
    else:
        folder.mkdir()
        (folder / "mine.txt").write_text("mine")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InputError, match=r"already exists; .* expected a new or an empty folder"):
        simulate_case(folder, seed=1, arm=gantry)
    assert sorted(tmp_path.rglob("*")) == before


def test_unreachable_pose_leaves_no_folder(tmp_path, gantry):
    class ShortArm(type(gantry)):
        def joints_for(self, base_from_tool, seed):
            raise MarginGuardError("out of reach")

    with pytest.raises(MarginGuardError, match="out of reach"):
        simulate_case(tmp_path / "case", seed=1, arm=ShortArm())
    assert list(tmp_path.iterdir()) == []
