import hashlib
import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import nrrd
import numpy as np
import pytest
import trimesh
import yaml

from app.case import convert_case, open_case
from app.geometry import InputError, MarginGuardError, MeshError

Manifest = dict[str, Any]
WriteCase = Callable[..., Path]


def test_complete_case_is_opened(manifest: Manifest, write_case: WriteCase) -> None:
    case = open_case(write_case(manifest))
    assert case.tool_mesh().frame == "cautery_tip"
    assert case.tumor_mesh().frame == "tumor"
    assert case.expected() is None
    assert not case.has_joints
    for _ in range(2):
        assert len(list(case.frames())) == 50
        assert case.notes() == ()


def test_meters_become_millimetres(manifest: Manifest, write_case: WriteCase) -> None:
    manifest["tumor"]["mesh"]["units"] = "m"
    low, high = open_case(write_case(manifest)).tumor_mesh().bounds_mm
    np.testing.assert_allclose(high - low, 20_000.0, rtol=1e-5)


def test_joints_are_on_the_trackers_clock(
    manifest: Manifest, write_case: WriteCase, tmp_path: Path
) -> None:
    (tmp_path / "packages/arm").mkdir(parents=True)
    (tmp_path / "packages/arm/arm.urdf").write_text("<robot/>")
    manifest["clock"] = {"offset_robot_to_tracker_ms": 4.0}
    manifest["robot"] = {
        "urdf": "package://arm/arm.urdf",
        "base_frame": "base",
        "tool_link": "stylus",
        "joint_states": "/joint_states",
    }
    manifest["registration"] = {"method": "given", "matrix": np.eye(4).ravel().tolist()}
    case = open_case(write_case(manifest, count=3), package_dirs=[tmp_path / "packages"])
    assert case.has_joints
    assert case.robot_urdf() == tmp_path / "packages/arm/arm.urdf"
    # Recorded at 15, 10, 5 and 0 ms before each frame, from 1 s on at 50 Hz.
    assert [[j.stamp.ns // 10**6 for j in f.joints] for f in case.frames()] == [
        [989, 994, 999],
        [1004, 1009, 1014, 1019],
        [1024, 1029, 1034, 1039, 1044],
    ]


def test_xacro_of_a_case_is_refused(
    manifest: Manifest, write_case: WriteCase, tmp_path: Path
) -> None:
    robot = {"urdf": "arm.xacro", "base_frame": "base", "tool_link": "stylus"}
    manifest["robot"] = robot
    manifest["registration"] = {"method": "given", "matrix": np.eye(4).ravel().tolist()}
    folder = write_case(manifest)
    (folder / "arm.xacro").write_text("<robot/>")
    with pytest.raises(InputError, match=r"robot\.urdf is 'arm\.xacro': a xacro file is code"):
        open_case(folder).robot_urdf()
    (tmp_path / "packages/arm").mkdir(parents=True)
    (tmp_path / "packages/arm/arm.xacro").write_text("<robot/>")
    robot["urdf"] = "package://arm/arm.xacro"
    (folder / "case.yaml").write_text(yaml.safe_dump(manifest))
    case = open_case(folder, package_dirs=[tmp_path / "packages"])
    assert case.robot_urdf() == tmp_path / "packages/arm/arm.xacro"


def test_frames_need_an_estimated_clock_offset(
    manifest: Manifest, write_case: WriteCase, tmp_path: Path
) -> None:
    (tmp_path / "arm").mkdir()
    (tmp_path / "arm/arm.urdf").write_text("<robot/>")
    manifest["clock"] = {"estimate": True}
    manifest["robot"] = {
        "urdf": "package://arm/arm.urdf",
        "base_frame": "base",
        "tool_link": "stylus",
        "joint_states": "/joint_states",
    }
    manifest["registration"] = {"method": "given", "matrix": np.eye(4).ravel().tolist()}
    with pytest.raises(InputError, match=r"clock\.estimate is true"):
        open_case(write_case(manifest), package_dirs=[tmp_path]).frames()


def test_cut_recording_is_used_with_a_note(manifest: Manifest, write_case: WriteCase) -> None:
    folder = write_case(manifest, count=700)
    path = folder / "tracking.mcap"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    case = open_case(folder)
    assert 100 < len(list(case.frames())) < 700
    (note,) = case.notes()
    assert "tracking.mcap is cut or damaged at byte" in note


def _replace(name: str, content: bytes) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_bytes(content)


def _link(name: str) -> Callable[[Path], object]:
    def edit(folder: Path) -> None:
        shutil.move(folder / name, folder.parent / f"outside_{name}")
        (folder / name).symlink_to(folder.parent / f"outside_{name}")

    return edit


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda f: (f / "case.yaml").unlink(), r"not a case: it has no case\.yaml"),
        (lambda f: (f / "tracking.mcap").unlink(), r"recording\.path is 'tracking\.mcap': no such"),
        (lambda f: (f / "tumor.stl").unlink(), r"tumor\.mesh\.path is 'tumor\.stl': no such file"),
        (_link("tracking.mcap"), r"recording\.path is 'tracking\.mcap': it leaves .* symbolic"),
        (_link("tumor.stl"), r"tumor\.mesh\.path is 'tumor\.stl': it leaves .* symbolic link"),
        (_link("tool.stl"), r"tool\.mesh\.path is 'tool\.stl': it leaves .* symbolic link"),
    ],
)
def test_missing_and_linked_files_are_refused(
    manifest: Manifest, write_case: WriteCase, edit: Callable[[Path], object], message: str
) -> None:
    folder = write_case(manifest)
    edit(folder)
    with pytest.raises(InputError, match=message) as caught:
        open_case(folder)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("block", "key"), [("recording", None), ("tool", "mesh"), ("tumor", "mesh")]
)
def test_paths_outside_the_folder_are_refused(
    manifest: Manifest, write_case: WriteCase, block: str, key: str | None
) -> None:
    entry = manifest[block] if key is None else manifest[block][key]
    entry["path"] = "../" + entry["path"]
    with pytest.raises(InputError, match=rf"case\.yaml: {block}.*path is '\.\./.*relative path"):
        open_case(write_case(manifest))


def test_sha256_is_checked(manifest: Manifest, write_case: WriteCase) -> None:
    folder = write_case(manifest)
    right = hashlib.sha256((folder / "tracking.mcap").read_bytes()).hexdigest()
    for digest in (right, right.upper()):
        manifest["recording"]["sha256"] = digest
        (folder / "case.yaml").write_text(yaml.safe_dump(manifest))
        open_case(folder)
    manifest["recording"]["sha256"] = "0" * 64
    (folder / "case.yaml").write_text(yaml.safe_dump(manifest))
    with pytest.raises(InputError, match=rf"sha256 is 0{{64}}: tracking\.mcap has {right}"):
        open_case(folder)


def test_pipe_as_recording_is_refused_without_blocking(
    manifest: Manifest, write_case: WriteCase
) -> None:
    folder = write_case(manifest)
    (folder / "tracking.mcap").unlink()
    os.mkfifo(folder / "tracking.mcap")
    with pytest.raises(
        InputError, match=r"recording\.path is 'tracking\.mcap': not a file or folder"
    ):
        open_case(folder)


def test_rosbag2_folder_with_a_link_outside_is_refused(
    manifest: Manifest, write_case: WriteCase
) -> None:
    manifest["recording"]["path"] = "bag"
    folder = write_case(manifest, count=10)
    (folder / "bag").mkdir()
    shutil.move(folder / "tracking.mcap", folder / "bag" / "bag_0.mcap")
    assert len(list(open_case(folder).frames())) == 10
    (folder / "bag/bag_1.mcap").symlink_to(folder / "tumor.stl")
    with pytest.raises(InputError, match=r"bag_1\.mcap': it leaves .* by a symbolic link"):
        open_case(folder)


def test_unknown_recording_format_is_refused(manifest: Manifest, write_case: WriteCase) -> None:
    manifest["recording"]["path"] = "tumor.stl"
    with pytest.raises(
        InputError,
        match=re.escape(
            "'tumor.stl'; expected one of .igs.mha, .igs.mhd, .igs.nrrd, .igs.nhdr, .seq.mha, "
            ".seq.mhd, .seq.nrrd, .mrb, .mrml, .xml of PerkTutor, .mcap, a rosbag2 folder"
        )
        + "$",
    ):
        open_case(write_case(manifest))


def test_igsio_header_is_checked_when_the_case_is_opened(
    manifest: Manifest, write_case: WriteCase
) -> None:
    manifest["recording"]["path"] = "x.igs.mha"
    folder = write_case(manifest, name="cut")
    (folder / "x.igs.mha").write_text("ObjectType = Image\nSeq_Frame0003_Timestamp = 1")
    with pytest.raises(InputError, match="cut at line 2, in frame 3"):
        open_case(folder)


@pytest.mark.parametrize("name", ["tumor", "tool"])
def test_open_and_broken_meshes_are_refused(
    manifest: Manifest, write_case: WriteCase, name: str
) -> None:
    case = open_case(write_case(manifest))
    load = case.tumor_mesh if name == "tumor" else case.tool_mesh
    box = trimesh.creation.box()
    path = case.folder / f"{name}.stl"
    trimesh.Trimesh(box.vertices, box.faces[1:]).export(path)
    with pytest.raises(MeshError, match=rf"{name}\.mesh\) is not closed: 3 edges"):
        load()
    trimesh.Trimesh(box.vertices, box.faces[:, ::-1]).export(path)
    with pytest.raises(MeshError, match="outward normals"):
        load()
    vertices = np.array(box.vertices)
    vertices[0] = np.nan
    trimesh.Trimesh(vertices, box.faces, process=False).export(path)
    with pytest.raises(MeshError, match="expected finite numbers"):
        load()


def test_a_tumour_from_a_contour(manifest: Manifest, write_case: WriteCase) -> None:
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
    note = "the tumour is the rounded convex hull of 42 points"
    for _ in range(2):
        assert len(list(case.frames())) == 3
        assert case.notes() == (note,)


def test_a_tumour_from_a_segmentation_is_converted_with_its_case(
    manifest: Manifest, write_case: WriteCase, tmp_path: Path
) -> None:
    manifest["tumor"]["mesh"] = {"path": "tumor.seg.nrrd", "segment": "2"}
    folder = write_case(manifest, count=3)
    marks = np.zeros((9, 9, 9), dtype=np.uint8)
    marks[2:7, 2:7, 2:7] = 2
    header = {
        "space": "left-posterior-superior",
        "space directions": np.eye(3),
        "space origin": np.zeros(3),
    }
    nrrd.write(str(folder / "tumor.seg.nrrd"), marks, header)
    convert_case(open_case(folder), tmp_path / "converted")
    case = open_case(tmp_path / "converted")
    low, high = case.tumor_mesh().bounds_mm
    np.testing.assert_allclose((low + high) / 2.0, [-4.0, -4.0, 4.0], atol=1e-3)
    assert case.notes() == ("the tumour is segment '2' of tumor.seg.nrrd, 125 voxels",)


def test_tool_without_mesh_fails_only_on_use(manifest: Manifest, write_case: WriteCase) -> None:
    del manifest["tool"]["mesh"]
    case = open_case(write_case(manifest))
    with pytest.raises(MeshError, match=r"tool\.mesh is missing"):
        case.tool_mesh()


def test_empty_manifest_is_refused(tmp_path: Path) -> None:
    (tmp_path / "case.yaml").touch()
    with pytest.raises(InputError, match=r"case\.yaml is empty; expected a mapping"):
        open_case(tmp_path)


def test_path_that_is_not_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MarginGuardError, match="no such folder"):
        open_case(tmp_path / "nowhere")
    (tmp_path / "case.yaml").touch()
    with pytest.raises(MarginGuardError, match=r"case\.yaml is not a case: expected a folder with"):
        open_case(tmp_path / "case.yaml")


def test_tumor_mesh_needs_its_repair_before_use(manifest: Manifest, write_case: WriteCase) -> None:
    manifest["tumor"]["mesh"]["repair"] = True
    case = open_case(write_case(manifest))
    ball = trimesh.creation.icosphere(subdivisions=1, radius=10.0)
    trimesh.Trimesh(ball.vertices, ball.faces[1:]).export(case.folder / "tumor.stl")
    with pytest.raises(
        InputError, match=r"tumor.mesh.repair is true: repair the mesh before its use"
    ):
        case.tumor_mesh()
    faulty = case.faulty_mesh("tumor")
    assert faulty.open_edges() == 3
    done = case.with_repaired_mesh("tumor", faulty, ["what was done"])
    assert done.tumor_mesh() is faulty
    assert len(list(done.frames())) == 50
    assert done.notes() == ("what was done",)
    with pytest.raises(InputError, match=r"tumor.mesh.repair is not true"):
        done.faulty_mesh("tumor")


@pytest.mark.parametrize("part", ["tumor", "tool"])
@pytest.mark.parametrize("wrong", ["yes please", 1])
def test_repair_must_be_boolean(
    manifest: Manifest, write_case: WriteCase, part: str, wrong: object
) -> None:
    manifest[part]["mesh"]["repair"] = wrong
    with pytest.raises(InputError, match=rf"{part}.mesh.repair"):
        open_case(write_case(manifest))
