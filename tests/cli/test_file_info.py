"""``marginguard info FILE``: what a file is, what it can be used for, what is missing."""

import numpy as np
import pytest
import trimesh

from tests.cli.command import refused, run, run_json

MATRIX = "1 0 0 10 0 0 -1 20 0 1 0 30 0 0 0 1"
PLUS = (
    "<PlusConfiguration><CoordinateDefinitions>"
    f'<Transform From="StylusTip" To="Stylus" Matrix="{MATRIX}"/>'
    "</CoordinateDefinitions></PlusConfiguration>"
)


def info(path, *options):
    found = run_json("info", path, *options)
    assert found["path"] == str(path)
    return found


def test_recording(project_root):
    found = info(project_root / "data/phantom_case/tracking.igs.mha")
    assert "recording" in found["kind"]
    assert found["facts"]["frames"] == "1000 in 66.606 s, 15.0 Hz on average"
    assert "tracker -> stylus: 1000 OK" in found["facts"].values()
    assert any("calibrate pivot" in use and "--tool stylus" in use for use in found["uses"])
    assert any("holds no joints" in entry for entry in found["missing"])


def test_recording_without_times_needs_a_rate(tmp_path):
    path = tmp_path / "x.igs.mha"
    rows = "".join(f"Seq_Frame000{i}_StylusToTrackerTransform = {MATRIX}\n" for i in range(3))
    path.write_text(f"NDims = 3\n{rows}ElementDataFile = LOCAL\n")
    assert "no frame with a Timestamp, but 3 without" in refused("info", path)
    assert "3 in 0.100 s" in info(path, "--rate-hz", "20")["facts"]["frames"]


def test_images_without_tracking_are_an_error(tmp_path):
    path = tmp_path / "x.igs.mha"
    path.write_text("Seq_Frame0000_Timestamp = 1\nElementDataFile = LOCAL\n")
    assert "holds 1 images without tracking" in refused("info", path)


def test_mesh_that_bounds_a_solid_and_one_that_does_not(tmp_path):
    box = trimesh.creation.box([10.0, 20.0, 30.0])
    metres, cut = box.copy(), box.copy()
    metres.apply_scale(0.001)
    cut.update_faces(np.arange(12) > 0)
    for mesh, name in ((box, "mm"), (metres, "m"), (cut, "open")):
        mesh.export(tmp_path / f"{name}.stl")
    assert info(tmp_path / "mm.stl")["facts"]["bounds a solid"] == "yes, 6000 mm3"
    for units in ("mm", "m"):
        use = f"tool.mesh or tumor.mesh of a case.yaml, with units: {units}"
        assert info(tmp_path / f"{units}.stl")["uses"] == [use]
    found = info(tmp_path / "open.stl")
    assert found["facts"]["bounds a solid"].startswith("no: ")
    assert "a tool or a tumour needs a mesh that bounds a solid" in found["missing"]


def test_robot(project_root):
    found = info(project_root / "data/robots/touch/touch.urdf")
    assert found["facts"]["joints"] == "waist, shoulder, elbow, yaw, pitch, roll"
    assert found["facts"]["end links"] == "stylus"


@pytest.mark.parametrize(
    ("name", "text", "fact", "missing"),
    [
        (
            "t.txt",
            MATRIX,
            ("rotation", "90 degrees"),
            "its frames: only the YAML format stores them",
        ),
        (
            "p.fcsv",
            "# columns = label,x,y,z,sel,vis\nA,1,2,3,1,1\n",
            ("names", "A"),
            "a contour of a tumour needs 4 points",
        ),
        ("c.xml", PLUS, ("transforms", "StylusTipToStylus"), "no landmarks of a phantom"),
    ],
)
def test_transform_points_and_configuration(tmp_path, name, text, fact, missing):
    (tmp_path / name).write_text(text)
    found = info(tmp_path / name)
    assert fact in found["facts"].items()
    assert missing in found["missing"]


def test_text_says_what_the_file_is(tmp_path):
    (tmp_path / "t.yaml").write_text(f"target: a\nsource: b\nmatrix: [{MATRIX.replace(' ', ', ')}]")
    printed = run("info", tmp_path / "t.yaml").out
    assert "  is             a rigid transform" in printed
    assert "  frames         a_from_b" in printed


@pytest.mark.parametrize("name", ["x.docx", "none"])
def test_other_files_are_refused_in_one_line(tmp_path, name):
    (tmp_path / "x.docx").write_text("")
    assert str(tmp_path) in refused("info", tmp_path / name)
