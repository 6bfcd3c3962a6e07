from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from app.case import (
    ContourEntry,
    Expected,
    ExpectedBreach,
    ExpectedBreaches,
    ExpectedDropout,
    ExpectedRegistration,
    SegmentationEntry,
    load_expected,
    load_manifest,
    write_expected,
)
from app.geometry import InputError, Transform
from tests.refusals import refused

ROBOT = {"urdf": "arm/arm.urdf", "base_frame": "robot_base", "tool_link": "stylus"}
ROBOT["joint_states"] = "/joint_states"
OVERLAPPING = [{"start_s": at, "end_s": end} for at, end in ((3.0, 4.0), (0.0, 1.0), (0.9, 2.0))]
MATRIX = [0.0, -1, 0, 10, 1, 0, 0, 20, 0, 0, 1, 30, 0, 0, 0, 1]


def load(tmp_path: Path, manifest: dict[str, Any]) -> Any:
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(manifest))
    return load_manifest(tmp_path)


def test_a_whole_manifest(tmp_path, manifest):
    manifest |= {
        "clock": {"offset_robot_to_tracker_ms": -12.5},
        "robot": ROBOT,
        "registration": {"method": "given", "matrix": MATRIX},
        "expected": "expected.yaml",
    }
    manifest["tool"]["tip_from"]["matrix"] = MATRIX
    manifest["margins"]["release_samples"] = 7
    case = load(tmp_path, manifest)
    assert case.clock.offset_robot_to_tracker_ns == -12_500_000
    tip = case.tool.tool_from_tip
    assert (tip.target, tip.source) == ("cautery", "cautery_tip")
    np.testing.assert_array_equal(tip.apply([1.0, 0.0, 0.0]), [10.0, 21.0, 30.0])
    pose = case.tumor.frame_from_tumor
    assert (pose.target, pose.source) == ("needle", "tumor")
    base = case.registration.reference_from_base
    assert (base.target, base.source) == ("reference", "robot_base")
    assert case.margins.stale_after_ns == 200_000_000
    assert (case.margins.release_samples, case.margins.release_band_mm) == (7, 0.5)
    assert case.robot.joint_states == "/joint_states"


def test_optional_sections_may_be_left_out(tmp_path, manifest):
    del manifest["tool"]["mesh"]
    case = load(tmp_path, manifest)
    assert case.tool.mesh is case.robot is case.registration is case.expected is None
    assert case.clock.offset_robot_to_tracker_ns == 0


def test_a_tumour_from_a_segmentation_or_a_contour(tmp_path, manifest):
    tumor = manifest["tumor"]
    tumor["mesh"] = {"path": "t.seg.nrrd", "segment": "Tumor"}
    found = load(tmp_path, manifest).tumor
    assert found.shape == SegmentationEntry("t.seg.nrrd", "Tumor")
    assert found.shape_key == "tumor.mesh"
    tumor["mesh"] = {"path": "t.NRRD"}
    assert load(tmp_path, manifest).tumor.shape == SegmentationEntry("t.NRRD", None)
    del tumor["mesh"]
    tumor["contour"] = {"path": "t.mrk.json"}
    found = load(tmp_path, manifest).tumor
    assert (found.shape, found.shape_key) == (ContourEntry("t.mrk.json"), "tumor.contour")


@pytest.mark.parametrize("method", ["paired_points", "robot_world"])
def test_registration_by_dwells_is_read(tmp_path, manifest, method):
    dwells = [{"start_s": 0.5, "end_s": 1.5}, {"start_s": 2.0, "end_s": 3.0}]
    manifest["registration"] = {"method": method, "dwells": dwells}
    entry = load(tmp_path, manifest).registration
    assert [(d.start_s, d.end_s) for d in entry.dwells] == [(0.5, 1.5), (2.0, 3.0)]


def test_registration_by_point_pairs_is_read(tmp_path, manifest):
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0.5]]
    manifest["registration"] = {"method": "paired_points", "fixed_mm": points, "moving_mm": points}
    assert load(tmp_path, manifest).registration.fixed_mm[2] == (0.0, 1.0, 0.5)


def place(manifest: dict[str, Any], path: str) -> tuple[dict[str, Any], str]:
    """The block that has the last key of ``path``, and that key."""
    *blocks, key = path.split(".")
    for block in blocks:
        manifest = manifest[block]
    return manifest, key


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("schema", 3, r"case\.yaml: schema is 3; expected 1 or 2"),
        ("colour", 1, r"case\.yaml: colour is unknown; expected one of schema, name"),
        ("tool.mesh.unit", "mm", r"tool\.mesh\.unit is unknown; .* path, units"),
        ("tool.mesh.units", "furlong", r"tool\.mesh\.units is 'furlong'; expected one of mm"),
        ("tumor.contour", {"path": "t.fcsv"}, r"tumor\.mesh and a contour are given"),
        ("tumor.mesh.segment", "T", r"mesh\.segment is given, but tumor\.stl is not a seg"),
        ("tumor.mesh.label", 1, r"mesh\.label is unknown; .* path, units, .*segment"),
        ("tumor.mesh.path", "t.nrrd",
         r"mesh\.units is given for a segmentation; its unit is always mm"),
        ("tumor.mesh", {"path": "t.stl"}, r"tumor\.mesh\.units is missing"),
        ("tumor.mesh", {"path": "t.nrrd", "segment": 1},
         r"tumor\.mesh\.segment is 1; expected a text"),
        ("tool.mesh.segment", "T", r"tool\.mesh\.segment is unknown"),
        ("tool", [], r"tool is \[\]; expected a mapping"),
        ("tool.frame", "a b", r"tool\.frame: frame name 'a b'"),
        ("tumor.pose.matrix", MATRIX[:12], r"tumor\.pose\.matrix is 12 values"),
        ("tumor.pose.matrix", [2.0, *MATRIX[1:]], r"tumor\.pose\.matrix: rotation"),
        ("tumor.pose.matrix", [-1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
         r"tumor\.pose\.matrix: .*reflection"),
        ("tumor.pose.matrix", [*MATRIX[:15], 2.0], r"last row"),
        ("tumor.pose.matrix", [float("nan"), *MATRIX[1:]], r"matrix\[0\] is nan"),
        ("margins.stop_mm", 9.0, r"margins\.warn_mm is 5; expected more than stop_mm \(9\)"),
        ("margins.stop_mm", 5.0, r"margins\.warn_mm is 5; expected more than stop_mm \(5\)"),
        ("tumor.frame", "cautery", r"tumor\.frame is 'cautery', the frame of the tool; expected"),
        ("margins.stop_mm", -1.0, r"margins\.stop_mm is -1; expected at least 0"),
        ("margins.stop_mm", "1", r"margins\.stop_mm is '1'; expected a number"),
        ("margins.stale_after_ms", 0, r"margins\.stale_after_ms is 0"),
        ("margins.release_samples", 1.5, r"margins\.release_samples is 1\.5; expected an integer"),
        ("recording.sha256", "abc", r"recording\.sha256 is 'abc'; expected 64 hex"),
        ("provenance.kind", "real", r"provenance\.kind is 'real'; expected one of simulated"),
        ("clock", {"estimate": True, "offset_robot_to_tracker_ms": 1}, r"clock\.estimate"),
        ("robot", ROBOT, r"registration is missing; expected one with a robot"),
        ("robot", ROBOT | {"joint_states": "x"}, r"robot\.joint_states is 'x'; expected a topic"),
        ("registration", {"method": "guess"}, r"registration\.method is 'guess'"),
        ("registration", {"method": "given"}, r"registration\.matrix is missing"),
        ("registration", {"method": "given", "matrix": MATRIX, "dwells": []},
         r"registration\.dwells does not belong to given"),
        ("registration", {"method": "paired_points", "fixed_mm": [[0, 0, 0]], "moving_mm": []},
         r"moving_mm has 0 points"),
        ("registration", {"method": "paired_points", "fixed_mm": [[0, 0]], "moving_mm": []},
         r"fixed_mm\[0\] is 2 values"),
        ("registration", {"method": "paired_points", "dwells": [{"start_s": 2.0, "end_s": 1.0}]},
         r"registration\.dwells\[0\]\.end_s is 1; expected a time after"),
        ("registration", {"method": "paired_points", "dwells": OVERLAPPING},
         r"registration\.dwells overlap: 0\.9 to 2 s starts before 0 to 1 s has ended"),
        ("registration", {"method": "robot_world", "dwells": []},
         r"registration\.dwells is empty; expected intervals"),
        ("registration", {"method": "paired_points", "fixed_mm": [], "moving_mm": []},
         r"registration\.fixed_mm is empty; expected points"),
    ],
)  # fmt: skip
def test_faults_are_refused_with_their_place(tmp_path, manifest, path, value, message):
    block, key = place(manifest, path)
    block[key] = value
    with refused(message):
        load(tmp_path, manifest)


@pytest.mark.parametrize(
    "path",
    ["name", "margins.k_tre", "margins.v_max_mm_s", "margins", "tool", "tumor.mesh",
     "provenance.licence", "tool.tip_from"],
)  # fmt: skip
def test_missing_required_keys_are_refused(tmp_path, manifest, path):
    block, key = place(manifest, path)
    del block[key]
    with refused(text=f"{path} is missing"):
        load(tmp_path, manifest)


def test_folder_without_manifest_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"is not a case: it has no case\.yaml"):
        load_manifest(tmp_path)


def load_values(path: Path) -> Expected:
    return load_expected(path, reference="reference", robot_base="base")


def test_written_values_are_read_back(tmp_path):
    pose = Transform.from_rotation_vector(
        [0.1, -0.7, 2.0], [1e-7, 5, -3], target="reference", source="base"
    )
    breaches = ExpectedBreach(1.0, 2.5, -3.25, True), ExpectedBreach(4.0, 4.5, -0.5)
    expected = Expected(
        ExpectedRegistration(pose, 1.0, 0.5),
        ExpectedBreaches(40.0, 0.5, breaches),
        (ExpectedDropout("needle", "missing", 0.5, 0.75),),
        frames=120,
    )
    write_expected(tmp_path / "expected.yaml", expected)
    read = load_values(tmp_path / "expected.yaml")
    found = read.registration.reference_from_base.matrix
    np.testing.assert_allclose(found, pose.matrix, atol=1e-14)
    assert (read.breaches, read.dropouts, read.frames) == (
        (expected.breaches, expected.dropouts, 120)
    )
    assert [p.name for p in tmp_path.iterdir()] == ["expected.yaml"]


def test_all_blocks_of_the_expected_values_are_optional(tmp_path):
    (tmp_path / "e.yaml").write_text("{}\n")
    assert load_values(tmp_path / "e.yaml") == Expected()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("breach: {}", "breach is unknown"),
        ("frames: 1.5", "frames is 1.5"),
        ("breaches: {tolerance_ms: 1, intervals: []}", "depth_tolerance_mm is missing"),
        ("dropouts: [{frame: a, kind: gone, start_s: 1, end_s: 2}]", r"dropouts\[0\].kind"),
        ("dropouts: [{frame: a, kind: missing, start_s: 3, end_s: 2}]",
         r"expected start_s \(3\) or later"),
    ],
)  # fmt: skip
def test_faults_of_the_expected_values_are_refused(tmp_path, text, message):
    (tmp_path / "e.yaml").write_text(text)
    with refused(message):
        load_values(tmp_path / "e.yaml")
