from pathlib import Path

import numpy as np
import pytest
import trimesh

from app.files import load_mesh, write_mesh
from app.files.mesh_file import MeshOptions
from app.geometry import InputError, MeshError, SurfaceMesh
from tests.refusals import refused


@pytest.mark.parametrize("suffix", ["stl", "STL", "ply", "obj"])
@pytest.mark.parametrize(("units", "scale"), [("mm", 1.0), ("cm", 10.0), ("m", 1000.0)])
def test_formats_and_units_are_applied(tmp_path, suffix, units, scale):
    sphere = trimesh.creation.icosphere(subdivisions=2, radius=2.0)
    path = tmp_path / f"sphere.{suffix}"
    sphere.export(path, file_type=suffix.lower())
    mesh = load_mesh(path, units=units, frame="tumor").require_closed("the sphere")
    assert (len(mesh.vertices_mm), len(mesh.faces)) == (len(sphere.vertices), len(sphere.faces))
    np.testing.assert_allclose(mesh.signed_volume_mm3, sphere.volume * scale**3, rtol=1e-5)
    assert mesh.frame == "tumor"


def test_degenerate_face_of_an_ascii_stl_is_dropped(tmp_path):
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    text = trimesh.exchange.stl.export_stl_ascii(box)
    corner = "vertex 0.5 1.0 1.5\n"
    flat = f"facet normal 0 0 0\nouter loop\n{corner * 2}vertex 0.5 1.0 -1.5\nendloop\nendfacet\n"
    path = tmp_path / "box.stl"
    path.write_text(text.replace("endsolid", flat + "endsolid"))
    mesh = load_mesh(path, units="mm", frame="tool").require_closed("the box")
    assert len(mesh.faces) == 12
    assert mesh.signed_volume_mm3 == pytest.approx(6.0)


def test_open_mesh_is_read_without_repair(tmp_path):
    box = trimesh.creation.box()
    box.update_faces(np.arange(len(box.faces)) > 0)
    box.export(tmp_path / "open.stl")
    mesh = load_mesh(tmp_path / "open.stl", units="mm", frame="tumor")
    with pytest.raises(MeshError, match="the tumour is not closed: 3 edges"):
        mesh.require_closed("the tumour")


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("suffix", ["stl", "ply", "obj"])
def test_vertices_that_are_not_finite_are_refused(tmp_path, suffix, value):
    box = trimesh.creation.box()
    vertices = np.array(box.vertices)
    vertices[3, 1] = value
    broken = trimesh.Trimesh(vertices, box.faces, process=False)
    path = tmp_path / f"broken.{suffix}"
    with np.errstate(invalid="ignore"):
        broken.export(path)
    with refused(rf"broken\.{suffix}: vertex \d+ .*finite", MeshError):
        load_mesh(path, units="mm", frame="tumor")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.stl", b""),
        ("a.stl", b"solid x\n"),
        ("a.stl", b"\x00" * 200),
        ("a.ply", b"nothing"),
        ("a.obj", b"# nothing\n"),
        ("a.vtk", b"x"),
        ("a.stl", b"\xff" * 84),
    ],
)
def test_file_without_a_surface_is_refused(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    words = rf"{name} (holds no triangles|is of an unknown format|is not an? |does not end)"
    with refused(words, MeshError):
        load_mesh(tmp_path / name, units="mm", frame="tumor")


def test_linked_files_are_not_read(tmp_path, caplog):
    """trimesh would log an invalid picture with a traceback."""
    (tmp_path / "secret.png").write_bytes(b"not for this case")
    ply = trimesh.creation.box().export(file_type="ply", encoding="ascii").decode()
    named = ply.replace("element vertex", "comment TextureFile secret.png\nelement vertex", 1)
    (tmp_path / "a.ply").write_text(named)
    with caplog.at_level("DEBUG"):
        mesh = load_mesh(tmp_path / "a.ply", units="mm", frame="tumor")
    assert (len(mesh.faces), "image" in caplog.text, "secret" in caplog.text) == (12, False, False)


def test_endless_file_is_refused(monkeypatch):
    monkeypatch.setattr("app.files.meshes._OPTIONS", MeshOptions(("",), 10_000, 10_000))
    with pytest.raises(MeshError, match="/dev/zero cannot be read: it is a device; expected"):
        load_mesh(Path("/dev/zero"), units="mm", frame="tumor")


MODEL = "vtkMRMLModelNode", "vtkMRMLModelStorageNode"


@pytest.mark.parametrize("suffix", ["stl", "ply", "obj"])
def test_model_of_slicer_keeps_its_position(tmp_path, slicer_node, suffix):
    path = tmp_path / f"ball.{suffix}"
    node, storage = slicer_node(*MODEL, path)
    ball = pytest.importorskip("vtk").vtkSphereSource()
    ball.SetCenter(10.0, 20.0, 30.0)
    ball.Update()
    node.SetAndObservePolyData(ball.GetOutput())
    assert storage.WriteData(node)
    assert b"SPACE=LPS" in path.read_bytes()[:200]
    mesh = load_mesh(path, units="mm", frame="tumor").require_closed("the ball")
    np.testing.assert_allclose(mesh.vertices_mm.mean(axis=0), [10.0, 20.0, 30.0], atol=1e-5)


@pytest.mark.parametrize("suffix", ["stl", "ply"])
def test_slicer_reads_a_written_mesh_at_its_position(tmp_path, slicer_node, suffix):
    ball = trimesh.creation.icosphere(subdivisions=2, radius=5.0)
    mesh = SurfaceMesh("tumor", np.add(ball.vertices, [10.0, 20.0, 30.0]), ball.faces)
    path = tmp_path / f"ball.{suffix}"
    write_mesh(path, mesh)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
    node, storage = slicer_node(*MODEL, path)
    assert storage.ReadData(node)
    bounds = np.zeros(6)
    node.GetBounds(bounds)
    np.testing.assert_allclose(bounds, [5.0, 15.0, 15.0, 25.0, 25.0, 35.0], atol=1e-5)
    again = load_mesh(path, units="mm", frame="tumor")
    assert len(again.faces) == len(mesh.faces)
    assert again.signed_volume_mm3 == pytest.approx(mesh.signed_volume_mm3, rel=1e-6)


def test_unusable_paths_and_axes_are_refused(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=1)
    mesh = SurfaceMesh("tumor", ball.vertices, ball.faces)
    for name, message in (
        ("ball.obj", r"ball\.obj is not a mesh file; expected \.stl or \.ply"),
        ("no/ball.stl", "parent directory does not exist"),
    ):
        with pytest.raises(InputError, match=message):
            write_mesh(tmp_path / name, mesh)
    trimesh.Trimesh(ball.vertices, ball.faces).export(tmp_path / "ball.stl")
    content = (tmp_path / "ball.stl").read_bytes()
    (tmp_path / "ball.stl").write_bytes(b"SPACE=IJK".ljust(80) + content[80:])
    with pytest.raises(MeshError, match="has SPACE=IJK; expected RAS or LPS"):
        load_mesh(tmp_path / "ball.stl", units="mm", frame="tumor")


def test_missing_file_and_unknown_units_are_refused(tmp_path):
    with pytest.raises(MeshError, match="cannot be read"):
        load_mesh(tmp_path / "no.stl", units="mm", frame="tumor")
    with pytest.raises(MeshError, match=r"'inch'; expected one of mm, cm, m"):
        load_mesh(tmp_path / "no.stl", units="inch", frame="tumor")
