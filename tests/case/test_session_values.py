"""Values of a session reach its recorder unchanged and become those of the recorded case."""

import io
import json
from dataclasses import fields, replace

import numpy as np
import pytest
import trimesh
import yaml

from app.case import (
    MarginEntry,
    RegistrationValues,
    SessionValues,
    StructureValues,
    begin_case,
    load_manifest,
    open_live,
    received_values,
    sent_values,
)
from app.case.manifest.structures import as_schema_2
from app.files.meshes import load_mesh, write_exact_ply
from app.geometry import FrameError, InputError, SurfaceMesh, Transform

MODEL = "{path: wire.ply, units: mm}"
BALL = trimesh.creation.icosphere(subdivisions=2, radius=7.0)
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
STYLUS_TIP = Transform("pointer", "pointer_tip", TURN, [2.0, 1 / 3, 140.7])
VALUES = SessionValues(
    tool_from_tip=Transform("cautery", "cautery_tip", TURN, [1 / 3, 2.0, 120.1]),
    tip_sigma_mm=0.2,
    frame_from_tumor=Transform("needle", "tumor", np.eye(3), [0.1, 0.0, 31.7]),
    tumor_sigma_mm=0.45,
    margins=MarginEntry(1.5, 6.0, 2.0, 50.0, 75_500_000, 3, 0.5, 1_000_000_000),
    tumor=SurfaceMesh("tumor", np.add(BALL.vertices, [1 / 3, -20.1, 0.7]), BALL.faces),
    registration=RegistrationValues(
        Transform("reference", "robot_base", TURN, [400.0, 0.1, 1 / 7]),
        np.diag([1e-6, 2e-6, 3e-6, 0.1, 0.2, 0.3]),
        12,
    ),
    items={
        "needle": {"length_mm": 61.5},
        "stylus": {"tip_from": {"matrix": STYLUS_TIP.matrix.ravel().tolist()}, "sigma_mm": 0.35},
    },
    image_depth_mm=45.0,
    structures=None,
)


WITH_STRUCTURES = replace(
    VALUES,
    structures=tuple(
        StructureValues(
            SurfaceMesh(name, np.multiply(BALL.vertices, size), BALL.faces),
            Transform(frame, name, TURN, [1 / 3, 40.0, -7.1]),
            *(role, 1.25, 3.5, 0.1),
        )
        for name, frame, role, size in (
            ("chest_wall", "reference", "forbidden", 1 / 3),
            ("lesion", "needle", "target", 0.7),
        )
    ),
)


def test_structures_arrive_unchanged_and_the_stream_goes_on_after_them():
    for tumor in (VALUES.tumor, None):
        values = replace(WITH_STRUCTURES, tumor=tumor)
        stream = io.BytesIO(b"".join(sent_values(values)) + b"next")
        found = received_values(stream).structures
        assert stream.read() == b"next"
        for mine, sent in zip(found, values.structures, strict=True):
            assert np.array_equal(mine.surface.vertices_mm, sent.surface.vertices_mm)
            assert np.array_equal(mine.surface.faces, sent.surface.faces)
            assert mine.surface.frame == mine.frame_from_structure.source
            pose = mine.frame_from_structure
            assert pose.target == sent.frame_from_structure.target
            assert np.array_equal(pose.matrix, sent.frame_from_structure.matrix)
            assert (mine.role, mine.stop_mm, mine.warn_mm, mine.sigma_mm) == (
                *(sent.role, sent.stop_mm, sent.warn_mm, sent.sigma_mm),
            )


def test_values_arrive_unchanged_and_the_stream_goes_on_after_them():
    stream = io.BytesIO(b"".join(sent_values(VALUES)) + b"next")
    found = received_values(stream)
    assert stream.read() == b"next"
    assert found.margins == VALUES.margins
    assert (found.tip_sigma_mm, found.tumor_sigma_mm) == (0.2, 0.45)
    assert (found.items, found.image_depth_mm) == (VALUES.items, 45.0)
    assert np.array_equal(found.tumor.vertices_mm, VALUES.tumor.vertices_mm)
    assert np.array_equal(found.tumor.faces, VALUES.tumor.faces)
    for mine, sent in (
        (found.tool_from_tip, VALUES.tool_from_tip),
        (found.frame_from_tumor, VALUES.frame_from_tumor),
        (found.registration.reference_from_base, VALUES.registration.reference_from_base),
    ):
        assert (mine.target, mine.source) == (sent.target, sent.source)
        assert np.array_equal(mine.matrix, sent.matrix)
    assert np.array_equal(found.registration.covariance, VALUES.registration.covariance)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"[]\n",
        b"{}\n",
        b"\xff\n",
        *(b"".join(sent_values(each))[:-5] for each in (VALUES, WITH_STRUCTURES)),
    ],
)
def test_other_bytes_are_refused(content):
    with pytest.raises(InputError, match=r"^values of the session: .* expected those that a live"):
        received_values(io.BytesIO(content))


@pytest.mark.parametrize("key", [each.name for each in fields(SessionValues)])
def test_values_without_a_key_are_refused(key):
    line, surfaces = b"".join(sent_values(VALUES)).split(b"\n", 1)
    document = json.loads(line)
    del document[key]
    with pytest.raises(InputError, match=r"^values of the session: .* expected those that a live"):
        received_values(io.BytesIO(json.dumps(document).encode() + b"\n" + surfaces))


@pytest.fixture
def live_file(project_root, tmp_path):
    """The example with more text, and with an old text replaced by a new one."""
    text = (project_root / "data" / "live_example" / "live.yaml").read_text()

    def written(more: str = "", old: str = "", new: str = ""):
        path = tmp_path / "live.yaml"
        path.write_text(f"{text}\n{more}\n".replace(old, new))
        return path

    return written


@pytest.mark.parametrize("schema", [1, 2])
@pytest.mark.parametrize("count", [0, 2])
def test_case_of_a_recording_has_the_structures_of_the_session(tmp_path, live_file, schema, count):
    path = live_file()
    if schema == 2:
        path.write_text(yaml.safe_dump(as_schema_2(yaml.safe_load(path.read_text()))))
    values = replace(WITH_STRUCTURES, structures=WITH_STRUCTURES.structures[:count])
    begin_case(open_live(path), tmp_path / "case", values)
    manifest = load_manifest(tmp_path / "case")
    assert manifest.margins.stop_mm == 1.5
    assert manifest.tumor.frame_from_tumor.translation_mm[2] == 31.7
    assert len(manifest.structures) == count
    for mine, sent in zip(manifest.structures, values.structures, strict=True):
        assert (mine.name, mine.role, mine.sigma_mm) == (sent.surface.frame, sent.role, 0.1)
        assert (mine.margins.stop_mm, mine.margins.warn_mm) == (1.25, 3.5)
        pose = sent.frame_from_structure.matrix
        assert np.array_equal(mine.frame_from_tumor.matrix, pose)
        found = load_mesh(tmp_path / "case" / mine.shape.path, units="mm", frame=mine.name)
        bounds = np.array(sent.surface.bounds_mm)
        assert np.array_equal(np.array(found.bounds_mm), bounds)


def test_case_of_a_recording_has_the_values_of_the_session(tmp_path, project_root):
    live = open_live(project_root / "data" / "live_example" / "live.yaml")
    begin_case(live, tmp_path / "case", VALUES)
    written = yaml.safe_load((tmp_path / "case" / "case.yaml").read_text())
    assert written["tool"]["tip_from"]["matrix"] == VALUES.tool_from_tip.matrix.ravel().tolist()
    assert written["tool"]["sigma_mm"] == 0.2
    assert written["tumor"]["pose"]["matrix"][11] == 31.7
    assert written["tumor"]["sigma_mm"] == 0.45
    assert written["margins"]["stale_after_ms"] == 75.5
    assert written["registration"]["degrees_of_freedom"] == 12
    assert written["registration"]["covariance"][35] == 0.3
    shape = written["tumor"]["mesh"]
    surface = load_mesh(tmp_path / "case" / shape["path"], units=shape["units"], frame="tumor")
    found, expected = (
        {np.sort(corners, axis=0).tobytes() for corners in mesh.triangles_mm}
        for mesh in (surface, VALUES.tumor)
    )
    assert found == expected


def test_case_of_a_recording_has_the_needle_as_it_is_shown(tmp_path, live_file):
    path = live_file(f"needle: {{frame: needle, length_mm: 60, model: {MODEL}}}")
    write_exact_ply(tmp_path / "wire.ply", SurfaceMesh("a", BALL.vertices, BALL.faces))
    begin_case(open_live(path), tmp_path / "case", VALUES)
    recorded = load_manifest(tmp_path / "case").items["needle"]
    assert (recorded.length_mm, recorded.direction) == (61.5, (0.0, 0.0, 1.0))
    assert (tmp_path / "case" / recorded.model.path).is_file()


def test_case_of_a_recording_has_the_calibrated_tip_of_the_stylus(tmp_path, live_file):
    live = open_live(live_file("stylus: {frame: pointer}"))
    assert live.case.manifest.items["stylus"].frame_from_tip is None
    begin_case(live, tmp_path / "case", VALUES)
    recorded = load_manifest(tmp_path / "case").items["stylus"]
    assert (recorded.frame, recorded.sigma_mm) == ("pointer", 0.35)
    assert np.array_equal(recorded.frame_from_tip.matrix, STYLUS_TIP.matrix)


def test_session_of_other_frames_than_those_of_the_file_is_refused(tmp_path, live_file):
    path = live_file(old="frame: needle", new="frame: reference")
    with pytest.raises(FrameError, match=r"live\.yaml: places 'tumor' in 'reference'; expected"):
        begin_case(open_live(path), tmp_path / "case", VALUES)
    assert not (tmp_path / "case").exists()


def test_slicer_reads_an_exact_mesh(tmp_path):
    slicer = pytest.importorskip("slicer")
    write_exact_ply(tmp_path / "ball.ply", VALUES.tumor)
    scene = slicer.vtkMRMLScene()
    node = scene.AddNewNodeByClass("vtkMRMLModelNode")
    storage = scene.AddNewNodeByClass("vtkMRMLModelStorageNode")
    storage.SetFileName(str(tmp_path / "ball.ply"))
    assert storage.ReadData(node)
    bounds = np.zeros(6)
    node.GetBounds(bounds)
    expected = np.sort(np.array(VALUES.tumor.bounds_mm).T, axis=1).ravel()
    np.testing.assert_allclose(bounds, expected, atol=1e-5)
