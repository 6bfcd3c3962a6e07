"""``marginguard replay`` on a small case: results, errors and written files."""

import re

import numpy as np
import pytest
import trimesh

from app.report import REPORT_FILES
from tests.cli import command
from tests.cli.small_case import edit_manifest, identity, write_small_case

pytestmark = pytest.mark.slow

TABLE_LINES = 41


@pytest.fixture
def case(tmp_path):
    return write_small_case(tmp_path / "case")


def replay(case, *options, status=0):
    return command.run("replay", case, "--no-ros", *options, status=status)


def replay_json(case, *options):
    return command.run_json("replay", case, "--no-ros", *options)


def refused(case, *options):
    return command.refused("replay", case, "--no-ros", *options)


def edit(file, old, new):
    """Replace text in a file of a case."""
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def test_breach_of_shaft_is_found_although_tip_is_far(case):
    summary = replay_json(case)
    assert summary["frames"] == 40
    (breach,) = summary["breaches"]
    # A side that is 5 mm from the centre of a ball of 8 mm, at rod positions below 9.5 mm.
    assert breach["min_signed_distance_mm"] == pytest.approx(-3.0, abs=0.1)
    assert (breach["start_s"], breach["end_s"]) == (0.95, 1.05)
    assert replay_json(case, "--tip-only")["breaches"] == []


def test_timed_run_with_a_needle_gives_the_same_table(case):
    table, summary = command.margin_table(case), replay_json(case)
    assert table.count(b"\n") == TABLE_LINES
    edit_manifest(case, lambda values: values.update(needle={"frame": "needle", "length_mm": 80}))
    assert command.margin_table(case, rate=20.0) == table
    timed = replay_json(case, "--rate", "20")
    assert timed | {"timing": None} == summary | {"timing": None}


def test_failed_expectations_give_status_1(case):
    edit_manifest(case, lambda manifest: manifest.update(expected="expected.yaml"))
    (case / "expected.yaml").write_text(
        "breaches: {tolerance_ms: 40, depth_tolerance_mm: 0.2, intervals: [\n"
        "  {start_s: 0.95, end_s: 1.05, min_signed_distance_mm: -3.0}]}\n"
    )
    replay(case)
    (case / "expected.yaml").write_text("frames: 41\n")
    assert "fail" in replay(case, status=1).out


def unknown_key(case):
    edit(case / "case.yaml", "stop_mm", "stop_mmm")


def open_mesh(case):
    mesh = trimesh.load_mesh(case / "tumor.stl")
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    mesh.export(case / "tumor.stl")


def cut_header(case):
    text = (case / "tracking.igs.mha").read_text()
    (case / "tracking.igs.mha").write_text(text[: len(text) // 2])


def bomb_as_robot(case):
    entities = "".join(f'<!ENTITY e{n + 1} "{f"&e{n};" * 10}">' for n in range(12))
    (case / "bomb.urdf").write_text(
        f'<!DOCTYPE robot [<!ENTITY e0 "x">{entities}]><robot name="&e12;"><link name="a"/></robot>'
    )
    edit(case / "tracking.igs.mha", "ToTracker", "ToReference")
    robot = {"urdf": "bomb.urdf", "base_frame": "robot_base", "tool_link": "a"}
    given = {"method": "given", "matrix": identity()}
    edit_manifest(case, lambda manifest: manifest.update(robot=robot, registration=given))


def frame_that_is_not_recorded(case):
    edit_manifest(case, lambda manifest: manifest["tool"].update(frame="scalpel"))


NO_SUCH_FRAME = (
    "case.yaml: tool.frame is 'scalpel': no such frame is in the recording; expected one of "
    "needle, rod, tracker"
)
BAD_INPUT = [
    (unknown_key, "margins.stop_mmm"),
    (open_mesh, "is not closed"),
    (cut_header, "tracking.igs.mha"),
    (bomb_as_robot, "bomb.urdf"),
    (frame_that_is_not_recorded, NO_SUCH_FRAME),
]


@pytest.mark.parametrize(
    ("spoil", "named"), BAD_INPUT, ids=[entry[0].__name__ for entry in BAD_INPUT]
)
def test_bad_input_is_one_line_and_overwrites_nothing(case, tmp_path, spoil, named):
    out = tmp_path / "out"
    out.mkdir()
    for name in REPORT_FILES:
        (out / name).write_text("of an earlier replay")
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    spoil(case)
    error = refused(case, "--report", out)
    assert error.startswith("marginguard: error: ")
    assert named in error
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    refused(case, "--report", tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_unwritable_report_folder_is_reported_before_replay(case, tmp_path):
    (tmp_path / "file").write_text("mine")
    assert "file" in refused(case, "--report", tmp_path / "file" / "out")
    assert (tmp_path / "file").read_text() == "mine"


def test_loop_with_report_is_refused(case, tmp_path):
    assert "--loop" in refused(case, "--loop", "--report", tmp_path / "out")


def test_base_that_is_measured_late_is_in_notes(case):
    urdf = "package://marginguard/robots/touch/touch.urdf"
    robot = {"urdf": urdf, "base_frame": "robot_base", "tool_link": "stylus"}
    given = {"method": "given", "matrix": identity()}
    edit_manifest(case, lambda manifest: manifest.update(robot=robot, registration=given))
    recording = case / "tracking.igs.mha"
    pose = " ".join(map(str, identity()))

    def measured(found):
        names = ["Reference"] + ["RobotBase"] * (int(found[1]) >= 5)
        lines = [f"Seq_Frame{found[1]}_{name}ToTrackerTransform = {pose}\n" for name in names]
        return "".join([*lines, found[0]])

    recording.write_text(re.sub(r"Seq_Frame(\d+)_Timestamp", measured, recording.read_text()))
    summary = replay_json(case)
    assert summary["valid_frames"] == 5
    assert (
        "robot.base_frame is 'robot_base'; expected a name of its own: the tracker measures it by "
        "tracker -> reference, tracker -> robot_base" in summary["notes"]
    )


def test_recording_without_valid_pose_reports_its_statuses(case):
    edit(case / "tracking.igs.mha", "= OK", "= INVALID")
    summary = replay_json(case)
    assert summary["valid_frames"] == 0
    notes = summary["notes"]
    assert "no frame was valid; the recording has the frames needle, rod, tracker" in notes


def test_crossing_between_two_frames_is_a_breach(case):
    def crossed(found):
        side = 30.0 if int(found[2]) < 20 else -30.0
        return f"{found[1]} = 1 0 0 {side + 0.01 * int(found[2])} 0 1 0 0 0 0 1 -30 0 0 0 1"

    recording = case / "tracking.igs.mha"
    poses = r"(Seq_Frame(\d+)_RodToTrackerTransform) =.*"
    recording.write_text(re.sub(poses, crossed, recording.read_text()))
    # 60 mm within a frame: no hand is as fast, and such a pose is not used.
    motion = {"max_speed_mm_s": 100_000, "max_acceleration_mm_s2": 10_000_000}
    edit_manifest(case, lambda manifest: manifest.update(plausibility={"motion": motion}))
    (breach,) = replay_json(case)["breaches"]
    assert breach["start_s"] == breach["end_s"] == 1.0
