"""``marginguard replay`` on a small case: results, errors and written files."""

import json
import re
import shutil

import numpy as np
import pytest
import trimesh
import yaml

from app.cli.main import main
from app.report import REPORT_FILES
from tests.cli.small_case import identity, write_small_case


@pytest.fixture
def case(tmp_path):
    return write_small_case(tmp_path / "case")


def replay(case, *options):
    return main(["replay", str(case), "--no-ros", *options])


def test_breach_of_shaft_is_found_although_tip_is_far(case, capsys):
    assert replay(case, "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["frames"] == 40
    (breach,) = summary["breaches"]
    # A side that is 5 mm from the centre of a ball of 8 mm, at rod positions below 9.5 mm.
    assert breach["min_signed_distance_mm"] == pytest.approx(-3.0, abs=0.1)
    assert (breach["start_s"], breach["end_s"]) == (0.95, 1.05)
    assert replay(case, "--json", "--tip-only") == 0
    assert json.loads(capsys.readouterr().out)["breaches"] == []


def test_runs_at_any_rate_give_same_bytes(case, tmp_path):
    contents = []
    for number, options in enumerate([(), (), ("--rate", "20")]):
        out = tmp_path / f"out{number}"
        assert replay(case, "--report", str(out), *options) == 0
        contents.append((out / "margin.csv").read_bytes())
    assert contents[0] == contents[1] == contents[2]
    assert contents[0].count(b"\n") == 41


def test_a_needle_changes_no_byte_of_the_margins(case, tmp_path):
    contents = []
    for name, needle in (("without", {}), ("with", {"frame": "needle", "length_mm": 80})):
        folder, out = tmp_path / name, tmp_path / f"report {name}"
        shutil.copytree(case, folder)
        manifest = yaml.safe_load((folder / "case.yaml").read_text())
        manifest |= {"needle": needle} if needle else {}
        (folder / "case.yaml").write_text(yaml.safe_dump(manifest, sort_keys=False))
        assert replay(folder, "--report", str(out)) == 0
        contents.append((out / "margin.csv").read_bytes())
    assert contents[0] == contents[1]
    assert contents[0].count(b"\n") == 41


def test_failed_expectations_give_status_1(tmp_path, capsys):
    def expect(manifest):
        manifest["expected"] = "expected.yaml"

    case = tmp_path / "case"
    write_small_case(case, expect)
    (case / "expected.yaml").write_text(
        "breaches: {tolerance_ms: 40, depth_tolerance_mm: 0.2, intervals: [\n"
        "  {start_s: 0.95, end_s: 1.05, min_signed_distance_mm: -3.0}]}\n"
    )
    assert replay(case) == 0
    (case / "expected.yaml").write_text("frames: 41\n")
    assert replay(case) == 1
    assert "fail" in capsys.readouterr().out


def drop_manifest(case):
    (case / "case.yaml").unlink()


def unknown_key(case):
    manifest = (case / "case.yaml").read_text()
    (case / "case.yaml").write_text(manifest.replace("stop_mm", "stop_mmm"))


def leave_the_folder(case):
    (case / "tumor.stl").rename(case.parent / "tumor.stl")
    manifest = (case / "case.yaml").read_text()
    (case / "case.yaml").write_text(manifest.replace("tumor.stl", "../tumor.stl"))


def link_out_of_the_folder(case):
    (case / "tumor.stl").rename(case.parent / "tumor.stl")
    (case / "tumor.stl").symlink_to(case.parent / "tumor.stl")


def wrong_sha256(case):
    manifest = (case / "case.yaml").read_text()
    digest = "0" * 64
    (case / "case.yaml").write_text(
        manifest.replace("path: tracking.igs.mha", f"path: tracking.igs.mha\n  sha256: '{digest}'")
    )


def open_mesh(case):
    mesh = trimesh.load_mesh(case / "tumor.stl")
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    mesh.export(case / "tumor.stl")


def mesh_with_nan(case):
    content = bytearray((case / "tumor.stl").read_bytes())
    content[96:100] = np.float32(np.nan).tobytes()
    (case / "tumor.stl").write_bytes(content)


def cut_header(case):
    text = (case / "tracking.igs.mha").read_text()
    (case / "tracking.igs.mha").write_text(text[: len(text) // 2])


def bomb_as_robot(case):
    entities = "".join(f'<!ENTITY e{n + 1} "{f"&e{n};" * 10}">' for n in range(12))
    (case / "bomb.urdf").write_text(
        f'<!DOCTYPE robot [<!ENTITY e0 "x">{entities}]><robot name="&e12;"><link name="a"/></robot>'
    )
    recording = case / "tracking.igs.mha"
    recording.write_text(recording.read_text().replace("ToTracker", "ToReference"))
    with (case / "case.yaml").open("a") as file:
        file.write("robot: {urdf: bomb.urdf, base_frame: robot_base, tool_link: a}\n")
        file.write(f"registration: {{method: given, matrix: {np.eye(4).ravel().tolist()}}}\n")


BAD_INPUT = [
    (drop_manifest, "has no case.yaml"),
    (unknown_key, "margins.stop_mmm"),
    (leave_the_folder, "tumor.mesh.path"),
    (link_out_of_the_folder, "tumor.mesh.path"),
    (wrong_sha256, "recording.sha256"),
    (open_mesh, "is not closed"),
    (mesh_with_nan, "finite"),
    (cut_header, "tracking.igs.mha"),
    (bomb_as_robot, "bomb.urdf"),
]


@pytest.mark.parametrize(
    ("spoil", "named"), BAD_INPUT, ids=[entry[0].__name__ for entry in BAD_INPUT]
)
def test_bad_input_is_one_line_and_overwrites_nothing(case, tmp_path, capsys, spoil, named):
    out = tmp_path / "out"
    out.mkdir()
    for name in REPORT_FILES:
        (out / name).write_text("of an earlier replay")
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    spoil(case)
    assert replay(case, "--report", str(out)) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1, captured.err
    assert captured.err.startswith("marginguard: error: ")
    assert named in captured.err
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_unwritable_report_folder_is_reported_before_replay(case, tmp_path, capsys):
    (tmp_path / "file").write_text("mine")
    assert replay(case, "--report", str(tmp_path / "file" / "out")) == 2
    assert "file" in capsys.readouterr().err
    assert (tmp_path / "file").read_text() == "mine"


def test_loop_with_report_is_refused(case, tmp_path, capsys):
    assert replay(case, "--loop", "--report", str(tmp_path / "out")) == 2
    assert "--loop" in capsys.readouterr().err


def test_debug_prints_traceback_and_same_line(case, capsys):
    drop_manifest(case)
    assert replay(case, "--debug") == 2
    error = capsys.readouterr().err
    assert "Traceback" in error
    assert error.splitlines()[-1].startswith("marginguard: error: ")


def test_frame_that_recording_lacks_is_refused(tmp_path, capsys):
    def other_tool(manifest):
        manifest["tool"]["frame"] = "scalpel"

    case = write_small_case(tmp_path / "other", other_tool)
    assert replay(case, "--report", str(tmp_path / "out")) == 2
    assert capsys.readouterr().err == (
        "marginguard: error: case.yaml: tool.frame is 'scalpel': no such frame is in the "
        "recording; expected one of needle, rod, tracker\n"
    )
    assert not (tmp_path / "out").exists()


def test_base_that_is_measured_late_is_in_notes(tmp_path, capsys):
    def with_robot(manifest):
        manifest["robot"] = {
            "urdf": "package://marginguard/robots/touch/touch.urdf",
            "base_frame": "robot_base",
            "tool_link": "stylus",
        }
        manifest["registration"] = {"method": "given", "matrix": identity()}

    case = write_small_case(tmp_path / "late", with_robot)
    recording = case / "tracking.igs.mha"
    pose = " ".join(map(str, identity()))

    def measured(line):
        at = re.match(r"Seq_Frame(\d+)_Timestamp", line)
        if at is None:
            return [line]
        names = ["Reference"] + ["RobotBase"] * (int(at[1]) >= 5)
        lines = [f"Seq_Frame{at[1]}_{name}ToTrackerTransform = {pose}" for name in names]
        return [*lines, line]

    lines = recording.read_text().splitlines()
    recording.write_text("\n".join(more for line in lines for more in measured(line)) + "\n")
    assert replay(case, "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["valid_frames"] == 5
    assert (
        "robot.base_frame is 'robot_base'; expected a name of its own: the tracker measures it by "
        "tracker -> reference, tracker -> robot_base" in summary["notes"]
    )


def test_recording_without_valid_pose_reports_its_statuses(case, capsys):
    recording = case / "tracking.igs.mha"
    recording.write_text(recording.read_text().replace("= OK", "= INVALID"))
    assert replay(case, "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["valid_frames"] == 0
    assert (
        "no frame was valid; the recording has the frames needle, rod, tracker" in summary["notes"]
    )


def test_tool_frame_equal_to_tumour_frame_is_refused(tmp_path, capsys):
    def same_frame(manifest):
        manifest["tumor"]["frame"] = "rod"

    assert replay(write_small_case(tmp_path / "same", same_frame)) == 2
    assert "tumor.frame is 'rod'" in capsys.readouterr().err


def test_empty_name_of_report_folder_is_refused(case, capsys):
    with pytest.raises(SystemExit) as stop:
        replay(case, "--report", "")
    assert stop.value.code == 2
    assert "empty" in capsys.readouterr().err


def test_crossing_between_two_frames_is_a_breach(tmp_path, capsys):
    case = write_small_case(tmp_path / "crossed")
    recording = (case / "tracking.igs.mha").read_text()
    lines = []
    for line in recording.splitlines():
        if "_RodToTrackerTransform =" in line:
            index = int(line[len("Seq_Frame") :][:4])
            side = 30.0 if index < 20 else -30.0
            pose = f"1 0 0 {side + 0.01 * index} 0 1 0 0 0 0 1 -30 0 0 0 1"
            line = f"Seq_Frame{index:04}_RodToTrackerTransform = {pose}"
        lines.append(line)
    (case / "tracking.igs.mha").write_text("\n".join(lines) + "\n")
    # 60 mm within a frame: no hand is as fast, and such a pose is not used.
    with (case / "case.yaml").open("a") as file:
        file.write(
            "plausibility: {motion: {max_speed_mm_s: 100000, max_acceleration_mm_s2: 10000000}}\n"
        )
    assert replay(case, "--json") == 0
    (breach,) = json.loads(capsys.readouterr().out)["breaches"]
    assert breach["start_s"] == breach["end_s"] == 1.0
