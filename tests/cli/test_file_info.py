"""``marginguard info FILE``: what a file is, what it can be used for, what is missing."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from app.cli.main import main

MATRIX = "1 0 0 10 0 0 -1 20 0 1 0 30 0 0 0 1"


def info(path: Path, capsys, *options: str) -> dict:
    assert main(["info", str(path), "--json", *options]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["path"] == str(path)
    return found


def test_recording(project_root, capsys) -> None:
    found = info(project_root / "data/phantom_case/tracking.igs.mha", capsys)
    assert "recording" in found["kind"]
    assert found["facts"]["frames"] == "1000 in 66.606 s, 15.0 Hz on average"
    assert "tracker -> stylus: 1000 OK" in found["facts"].values()
    assert any("calibrate pivot" in use and "--tool stylus" in use for use in found["uses"])
    assert any("holds no joints" in entry for entry in found["missing"])


def test_recording_without_times_needs_a_rate(tmp_path, capsys) -> None:
    path = tmp_path / "x.igs.mha"
    rows = "".join(f"Seq_Frame000{i}_StylusToTrackerTransform = {MATRIX}\n" for i in range(3))
    path.write_text(f"NDims = 3\n{rows}ElementDataFile = LOCAL\n")
    assert main(["info", str(path)]) == 2
    assert "no frame with a Timestamp, but 3 without" in capsys.readouterr().err
    assert "3 in 0.100 s" in info(path, capsys, "--rate-hz", "20")["facts"]["frames"]


def test_images_without_tracking_are_an_error(tmp_path, capsys) -> None:
    path = tmp_path / "x.igs.mha"
    path.write_text("Seq_Frame0000_Timestamp = 1\nElementDataFile = LOCAL\n")
    assert main(["info", str(path)]) == 2
    assert "holds 1 images without tracking" in capsys.readouterr().err


def test_mesh_that_bounds_a_solid_and_one_that_does_not(tmp_path, capsys) -> None:
    box = trimesh.creation.box([10.0, 20.0, 30.0])
    box.export(tmp_path / "box.stl")
    found = info(tmp_path / "box.stl", capsys)
    assert found["facts"]["bounds a solid"] == "yes, 6000 mm3"
    assert found["uses"] == ["tool.mesh or tumor.mesh of a case.yaml, with units: mm"]
    metres = box.copy()
    metres.apply_scale(0.001)
    metres.export(tmp_path / "metres.stl")
    found = info(tmp_path / "metres.stl", capsys)
    assert found["uses"] == ["tool.mesh or tumor.mesh of a case.yaml, with units: m"]
    box.update_faces(np.arange(12) > 0)
    box.export(tmp_path / "open.stl")
    found = info(tmp_path / "open.stl", capsys)
    assert found["facts"]["bounds a solid"].startswith("no: ")
    assert "a tool or a tumour needs a mesh that bounds a solid" in found["missing"]


def test_robot(project_root, capsys) -> None:
    found = info(project_root / "data/robots/touch/touch.urdf", capsys)
    assert found["facts"]["joints"] == "waist, shoulder, elbow, yaw, pitch, roll"
    assert found["facts"]["end links"] == "stylus"


def test_transform_points_and_configuration(tmp_path, capsys) -> None:
    (tmp_path / "t.txt").write_text(MATRIX)
    found = info(tmp_path / "t.txt", capsys)
    assert found["facts"]["rotation"] == "90 degrees"
    assert found["missing"] == ["its frames: only the YAML format stores them"]
    (tmp_path / "p.fcsv").write_text("# columns = label,x,y,z,sel,vis\nA,1,2,3,1,1\n")
    found = info(tmp_path / "p.fcsv", capsys)
    assert found["facts"]["names"] == "A"
    assert "a contour of a tumour needs 4 points" in found["missing"]
    (tmp_path / "c.xml").write_text(
        "<PlusConfiguration><CoordinateDefinitions>"
        f'<Transform From="StylusTip" To="Stylus" Matrix="{MATRIX}"/>'
        "</CoordinateDefinitions></PlusConfiguration>"
    )
    found = info(tmp_path / "c.xml", capsys)
    assert found["facts"]["transforms"] == "StylusTipToStylus"
    assert "no landmarks of a phantom" in found["missing"]


def test_text_says_what_the_file_is(tmp_path, capsys) -> None:
    (tmp_path / "t.yaml").write_text(f"target: a\nsource: b\nmatrix: [{MATRIX.replace(' ', ', ')}]")
    assert main(["info", str(tmp_path / "t.yaml")]) == 0
    printed = capsys.readouterr().out
    assert "  is             a rigid transform" in printed
    assert "  frames         a_from_b" in printed


@pytest.mark.parametrize("name", ["x.docx", "none"])
def test_other_files_are_refused_in_one_line(tmp_path, capsys, name) -> None:
    (tmp_path / "x.docx").write_text("")
    assert main(["info", str(tmp_path / name)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and str(tmp_path) in error
