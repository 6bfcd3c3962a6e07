"""Cases are opened as a whole: recording, meshes, tumour, files that are missing or elsewhere."""

import hashlib
import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import nrrd
import numpy as np
import pytest
import trimesh
import yaml

from app.case import convert_case, open_case, open_live, read_recording, recover_recording
from app.geometry import InputError, MarginGuardError, MeshError
from tests.case.conftest import write_manifest
from tests.refusals import refused


def test_complete_case_is_opened(manifest, write_case):
    case = open_case(write_case(manifest))
    assert case.tool_mesh().frame == "cautery_tip"
    assert case.tumor_mesh().frame == "tumor"
    assert case.expected() is None
    assert not case.has_joints
    for _ in range(2):
        assert len(list(case.frames())) == 50
        assert case.notes() == ()


def test_meters_become_millimetres(manifest, write_case):
    manifest["tumor"]["mesh"]["units"] = "m"
    low, high = open_case(write_case(manifest)).tumor_mesh().bounds_mm
    np.testing.assert_allclose(high - low, 20_000.0, rtol=1e-5)


def test_cut_recording_is_used_with_a_note(manifest, write_case):
    folder = write_case(manifest, count=700)
    path = folder / "tracking.mcap"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    case = open_case(folder)
    assert 100 < len(list(case.frames())) < 700
    (note,) = case.notes()
    assert "tracking.mcap is cut or damaged at byte" in note


def remove(name: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).unlink()


def link(name: str) -> Callable[[Path], object]:
    def edit(folder: Path) -> None:
        shutil.move(folder / name, folder.parent / f"outside_{name}")
        (folder / name).symlink_to(folder.parent / f"outside_{name}")

    return edit


def pipe(folder: Path) -> None:
    (folder / "tracking.mcap").unlink()
    os.mkfifo(folder / "tracking.mcap")


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (remove("case.yaml"), r"not a case: it has no case\.yaml"),
        (remove("tracking.mcap"), r"recording\.path is 'tracking\.mcap': no such"),
        (remove("tumor.stl"), r"tumor\.mesh\.path is 'tumor\.stl': no such file"),
        (link("tracking.mcap"), r"recording\.path is 'tracking\.mcap': it leaves .* symbolic"),
        (link("tumor.stl"), r"tumor\.mesh\.path is 'tumor\.stl': it leaves .* symbolic link"),
        (link("tool.stl"), r"tool\.mesh\.path is 'tool\.stl': it leaves .* symbolic link"),
        (pipe, r"recording\.path is 'tracking\.mcap': not a file or folder"),
        (lambda f: (f / "case.yaml").write_text(""), r"case\.yaml is empty; expected a mapping"),
    ],
)
def test_missing_linked_and_empty_files_are_refused(manifest, write_case, edit, message):
    folder = write_case(manifest)
    edit(folder)
    with refused(message):
        open_case(folder)


@pytest.mark.parametrize(
    ("block", "key"), [("recording", None), ("tool", "mesh"), ("tumor", "mesh")]
)
def test_paths_outside_the_folder_are_refused(manifest, write_case, block, key):
    entry = manifest[block] if key is None else manifest[block][key]
    entry["path"] = "../" + entry["path"]
    with pytest.raises(InputError, match=rf"case\.yaml: {block}.*path is '\.\./.*relative path"):
        open_case(write_case(manifest))


def test_sha256_is_checked(manifest, write_case):
    folder = write_case(manifest)
    right = hashlib.sha256((folder / "tracking.mcap").read_bytes()).hexdigest()
    for digest in (right, right.upper()):
        manifest["recording"]["sha256"] = digest
        open_case(write_manifest(folder, manifest))
    manifest["recording"]["sha256"] = "0" * 64
    with pytest.raises(InputError, match=rf"sha256 is 0{{64}}: tracking\.mcap has {right}"):
        open_case(write_manifest(folder, manifest))


def test_rosbag2_folder_with_a_link_outside_is_refused(manifest, write_case):
    manifest["recording"]["path"] = "bag"
    folder = write_case(manifest, count=10)
    (folder / "bag").mkdir()
    shutil.move(folder / "tracking.mcap", folder / "bag" / "bag_0.mcap")
    assert len(list(open_case(folder).frames())) == 10
    (folder / "bag/bag_1.mcap").symlink_to(folder / "tumor.stl")
    with pytest.raises(InputError, match=r"bag_1\.mcap': it leaves .* by a symbolic link"):
        open_case(folder)


def test_unknown_recording_format_and_cut_header_are_refused(manifest, write_case):
    manifest["recording"]["path"] = "tumor.stl"
    expected = (
        "'tumor.stl'; expected one of .igs.mha, .igs.mhd, .igs.nrrd, .igs.nhdr, .seq.mha, "
        ".seq.mhd, .seq.nrrd, .mrb, .mrml, .xml of PerkTutor, .mcap, a rosbag2 folder"
    )
    with pytest.raises(InputError, match=re.escape(expected) + "$"):
        open_case(write_case(manifest))
    manifest["recording"]["path"] = "x.igs.mha"
    folder = write_case(manifest, name="cut")
    (folder / "x.igs.mha").write_text("ObjectType = Image\nSeq_Frame0003_Timestamp = 1")
    with pytest.raises(InputError, match="cut at line 2, in frame 3"):
        open_case(folder)


@pytest.mark.parametrize("name", ["tumor", "tool"])
def test_open_and_broken_meshes_are_refused(manifest, write_case, name):
    case = open_case(write_case(manifest))
    load = case.tumor_mesh if name == "tumor" else case.tool_mesh
    box = trimesh.creation.box()
    broken = np.array(box.vertices)
    broken[0] = np.nan
    for vertices, faces, message in (
        (box.vertices, box.faces[1:], rf"{name}\.mesh\) is not closed: 3 edges"),
        (box.vertices, box.faces[:, ::-1], "outward normals"),
        (broken, box.faces, "expected finite numbers"),
    ):
        trimesh.Trimesh(vertices, faces, process=False).export(case.folder / f"{name}.stl")
        with pytest.raises(MeshError, match=message):
            load()


def test_a_tumour_from_a_contour(manifest, write_case):
    del manifest["tumor"]["mesh"]
    manifest["tumor"]["contour"] = {"path": "contour.yaml"}
    folder = write_case(manifest, count=3)
    points = np.array(trimesh.creation.icosphere(subdivisions=1, radius=10.0).vertices)
    entries = [{"name": "T", "position_mm": point} for point in points.tolist()]
    with pytest.raises(InputError, match=r"tumor\.contour\.path is 'contour\.yaml': no such file"):
        open_case(folder)
    (folder / "contour.yaml").write_text(yaml.safe_dump({"landmarks": entries}))
    case = open_case(folder)
    mesh = case.tumor_mesh()
    assert mesh is case.tumor_mesh()
    assert mesh.frame == "tumor"
    assert mesh.signed_volume_mm3 == pytest.approx(4000.0 / 3.0 * np.pi, rel=0.01)
    for _ in range(2):
        assert len(list(case.frames())) == 3
        assert case.notes() == ("the tumour is the rounded convex hull of 42 points",)


def test_a_tumour_from_a_segmentation_is_converted_with_its_case(manifest, write_case, tmp_path):
    manifest["tumor"]["mesh"] = {"path": "tumor.seg.nrrd", "segment": "2"}
    folder = write_case(manifest, count=3)
    marks = np.zeros((9, 9, 9), dtype=np.uint8)
    marks[2:7, 2:7, 2:7] = 2
    header = {"space": "left-posterior-superior", "space directions": np.eye(3)}
    header["space origin"] = np.zeros(3)
    nrrd.write(str(folder / "tumor.seg.nrrd"), marks, header)
    convert_case(open_case(folder), tmp_path / "converted")
    case = open_case(tmp_path / "converted")
    low, high = case.tumor_mesh().bounds_mm
    np.testing.assert_allclose((low + high) / 2.0, [-4.0, -4.0, 4.0], atol=1e-3)
    assert case.notes() == ("the tumour is segment '2' of tumor.seg.nrrd, 125 voxels",)


def test_tool_without_mesh_fails_only_on_use(manifest, write_case):
    del manifest["tool"]["mesh"]
    case = open_case(write_case(manifest))
    with pytest.raises(MeshError, match=r"tool\.mesh is missing"):
        case.tool_mesh()


def test_path_that_is_not_a_folder_is_refused(tmp_path):
    with pytest.raises(MarginGuardError, match="no such folder"):
        open_case(tmp_path / "nowhere")
    (tmp_path / "case.yaml").touch()
    with pytest.raises(MarginGuardError, match=r"case\.yaml is not a case: expected a folder with"):
        open_case(tmp_path / "case.yaml")


@pytest.mark.parametrize("name", ["a" * 100_000, "a" * 100_000 + ".mcap"])
def test_long_names_are_refused_in_one_line(tmp_path, name):
    path = tmp_path / name
    for read in (
        lambda: open_case(path),
        lambda: open_live(path),
        lambda: list(read_recording(path, print)),
        lambda: recover_recording(path, tmp_path / "new.mcap"),
        lambda: recover_recording(tmp_path, path),
    ):
        with refused():
            read()
    assert list(tmp_path.iterdir()) == []


def test_tumor_mesh_needs_its_repair_before_use(manifest, write_case):
    manifest["tumor"]["mesh"]["repair"] = True
    case = open_case(write_case(manifest))
    ball = trimesh.creation.icosphere(subdivisions=1, radius=10.0)
    trimesh.Trimesh(ball.vertices, ball.faces[1:]).export(case.folder / "tumor.stl")
    with refused("tumor.mesh.repair is true: repair the mesh before its use"):
        case.tumor_mesh()
    faulty = case.faulty_mesh(case.manifest.tumor)
    assert faulty.open_edges() == 3
    done = case.with_repaired_mesh(case.manifest.tumor, faulty, ["what was done"])
    assert done.tumor_mesh() is faulty
    assert len(list(done.frames())) == 50
    assert done.notes() == ("what was done",)
    with pytest.raises(InputError, match=r"tumor.mesh.repair is not true"):
        done.faulty_mesh(done.manifest.tumor)


@pytest.mark.parametrize("part", ["tumor", "tool"])
@pytest.mark.parametrize("wrong", ["yes please", 1])
def test_repair_must_be_boolean(manifest, write_case, part, wrong):
    manifest[part]["mesh"]["repair"] = wrong
    with pytest.raises(InputError, match=rf"{part}.mesh.repair"):
        open_case(write_case(manifest))
