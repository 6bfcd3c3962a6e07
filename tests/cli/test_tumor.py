"""``marginguard tumor``: contours and segmentations to meshes, checks and repair."""

from pathlib import Path

import nrrd
import numpy as np
import pytest
import trimesh
import yaml

from tests.cli.command import refused, run, run_json

pytestmark = pytest.mark.slow


@pytest.fixture
def contour(tmp_path: Path) -> Path:
    """Points on a sphere of radius 10 mm around (20, 30, 40)."""
    points = np.add(trimesh.creation.icosphere(subdivisions=1, radius=10.0).vertices, [20, 30, 40])
    entries = [{"name": "T", "position_mm": point} for point in points.tolist()]
    path = tmp_path / "contour.yaml"
    path.write_text(yaml.safe_dump({"landmarks": entries}))
    return path


@pytest.fixture
def segmentation(tmp_path: Path) -> Path:
    """Two blocks: 10 x 10 x 10 mm and 4 x 4 x 4 mm."""
    labels = np.zeros((20, 20, 20), dtype=np.uint8)
    labels[2:12, 2:12, 2:12] = 1
    labels[14:18, 14:18, 14:18] = 2
    header = {
        "space": "right-anterior-superior",
        "space directions": np.eye(3),
        "space origin": np.zeros(3),
        **{f"Segment{i}_{key}": text for i, name in enumerate(("Tumor", "Node"))
           for key, text in (("ID", f"S{i}"), ("Name", name), ("Layer", "0"),
                             ("LabelValue", str(i + 1)))},
    }  # fmt: skip
    path = tmp_path / "labels.seg.nrrd"
    nrrd.write(str(path), labels, header)
    return path


@pytest.mark.parametrize("ending", ["stl", "ply"])
def test_contour_becomes_mesh_that_other_programs_read(contour, tmp_path, ending):
    path = tmp_path / f"tumor.{ending}"
    out = run("tumor", contour, "-o", path).out
    assert "20.0 x 20.0 x 20.0 mm, around (20.0, 30.0, 40.0) mm" in out
    assert "rounded convex hull of 42 points" in out
    assert f"wrote {path}" in out
    mesh = trimesh.load_mesh(path)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(4000.0 / 3.0 * np.pi, rel=0.01)
    found = run_json("tumor", path, "--units", "mm")
    assert found["sound"]
    assert found["parts"] == 1
    assert found["volume_mm3"] == pytest.approx(mesh.volume, rel=1e-5)


def test_segment_is_selected_by_name(segmentation):
    found = run_json("tumor", segmentation, "--segment", "Node")
    assert found["middle_mm"] == pytest.approx([15.5] * 3, abs=1e-3)
    assert found["volume_mm3"] == pytest.approx(64.0, rel=0.02)
    assert found["notes"] == ["the tumour is segment 'Node' of labels.seg.nrrd, 64 voxels"]
    assert "holds 2 segments: Tumor (S0), Node (S1)" in refused("tumor", segmentation)


def test_mesh_that_bounds_no_solid_is_written_only_when_repaired(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=10.0)
    trimesh.Trimesh(ball.vertices, ball.faces[1:]).export(tmp_path / "open.stl")
    words = ("tumor", tmp_path / "open.stl", "--units", "mm", "-o", tmp_path / "out.stl")
    assert "no: " in run(*words, status=1).out
    assert not (tmp_path / "out.stl").exists()
    assert "was repaired" in run(*words, "--repair").out
    assert trimesh.load_mesh(tmp_path / "out.stl").volume == pytest.approx(ball.volume)


def test_mesh_is_not_overwritten_by_its_output(tmp_path):
    ball = tmp_path / "ball.stl"
    trimesh.creation.icosphere(subdivisions=3, radius=1.0).export(ball)
    (tmp_path / "link.stl").symlink_to(ball)
    before = ball.read_bytes()
    for name in ("ball.stl", "link.stl"):
        error = refused("tumor", ball, "--units", "cm", "-o", tmp_path / name)
        assert f"{name} is SOURCE; expected another file" in error
    assert ball.read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["tumor.stl"], "--units is missing"),
        (["contour.yaml", "--units", "mm"], "--units is given, but contour.yaml is always in mm"),
        (["contour.yaml", "--segment", "1"], "--segment is given, but contour.yaml is not a seg"),
        (["contour.yaml", "-o", "tumor.vtk"], "is not a mesh file; expected .stl or .ply"),
        (["contour.yaml", "-o", "no/tumor.stl"], "parent directory does not exist"),
        (["contour.yaml", "-o", "/proc/tumor.stl"], "/proc/tumor.stl cannot be written: No such"),
        (
            ["contour.txt"],
            "contour.txt is not a tumour file; expected one of .mrk.json, .fcsv, .yaml, .yml",
        ),
        (["no.nrrd"], "no.nrrd cannot be read"),
    ],
)
def test_bad_input_is_one_line(contour, arguments, message, monkeypatch):
    monkeypatch.chdir(contour.parent)
    assert message in refused("tumor", *arguments)
