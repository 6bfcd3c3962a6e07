from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from app.case import ContourEntry, SegmentationEntry, load_manifest
from app.geometry import InputError

ROBOT = {
    "urdf": "arm/arm.urdf",
    "base_frame": "robot_base",
    "tool_link": "stylus",
    "joint_states": "/joint_states",
}
MATRIX = [0.0, -1, 0, 10, 1, 0, 0, 20, 0, 0, 1, 30, 0, 0, 0, 1]
Edit = Callable[[dict[str, Any]], object]


def load(tmp_path: Path, manifest: dict[str, Any]) -> Any:
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(manifest))
    return load_manifest(tmp_path)


def test_a_whole_manifest(tmp_path: Path, manifest: dict[str, Any]) -> None:
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
    assert (case.tumor.frame_from_tumor.target, case.tumor.frame_from_tumor.source) == (
        "needle",
        "tumor",
    )
    base = case.registration.reference_from_base
    assert (base.target, base.source) == ("reference", "robot_base")
    assert case.margins.stale_after_ns == 200_000_000
    assert (case.margins.release_samples, case.margins.release_band_mm) == (7, 0.5)
    assert case.robot.joint_states == "/joint_states"


def test_optional_sections_may_be_left_out(tmp_path: Path, manifest: dict[str, Any]) -> None:
    del manifest["tool"]["mesh"]
    case = load(tmp_path, manifest)
    assert case.tool.mesh is case.robot is case.registration is case.expected is None
    assert case.clock.offset_robot_to_tracker_ns == 0


def test_a_tumour_from_a_segmentation_or_a_contour(
    tmp_path: Path, manifest: dict[str, Any]
) -> None:
    tumor = manifest["tumor"]
    tumor["mesh"] = {"path": "t.seg.nrrd", "segment": "Tumor"}
    case = load(tmp_path, manifest)
    assert case.tumor.shape == SegmentationEntry("t.seg.nrrd", "Tumor")
    assert case.tumor.shape_key == "tumor.mesh"
    tumor["mesh"] = {"path": "t.NRRD"}
    assert load(tmp_path, manifest).tumor.shape == SegmentationEntry("t.NRRD", None)
    del tumor["mesh"]
    tumor["contour"] = {"path": "t.mrk.json"}
    case = load(tmp_path, manifest)
    assert case.tumor.shape == ContourEntry("t.mrk.json")
    assert case.tumor.shape_key == "tumor.contour"


@pytest.mark.parametrize("method", ["paired_points", "robot_world"])
def test_registration_by_dwells_is_read(
    tmp_path: Path, manifest: dict[str, Any], method: str
) -> None:
    dwells = [{"start_s": 0.5, "end_s": 1.5}, {"start_s": 2.0, "end_s": 3.0}]
    manifest["registration"] = {"method": method, "dwells": dwells}
    entry = load(tmp_path, manifest).registration
    assert [(d.start_s, d.end_s) for d in entry.dwells] == [(0.5, 1.5), (2.0, 3.0)]


def test_registration_by_point_pairs_is_read(tmp_path: Path, manifest: dict[str, Any]) -> None:
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0.5]]
    manifest["registration"] = {"method": "paired_points", "fixed_mm": points, "moving_mm": points}
    assert load(tmp_path, manifest).registration.fixed_mm[2] == (0.0, 1.0, 0.5)


def _set(*keys: str, to: object) -> Edit:
    def edit(manifest: dict[str, Any]) -> None:
        for key in keys[:-1]:
            manifest = manifest[key]
        manifest[keys[-1]] = to

    return edit


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (_set("schema", to=2), r"schema is 2; expected 1"),
        (_set("colour", to=1), r"case\.yaml: colour is unknown; expected one of schema, name"),
        (_set("tool", "mesh", "unit", to="mm"), r"tool\.mesh\.unit is unknown; .* path, units"),
        (
            _set("tool", "mesh", "units", to="furlong"),
            r"tool\.mesh\.units is 'furlong'; expected one of mm",
        ),
        (_set("tumor", "contour", to={"path": "t.fcsv"}), r"tumor\.mesh and a contour are given"),
        (
            _set("tumor", "mesh", "segment", to="T"),
            r"mesh\.segment is given, but tumor\.stl is not a seg",
        ),
        (
            _set("tumor", "mesh", "label", to=1),
            r"mesh\.label is unknown; .* path, units, .*segment",
        ),
        (
            _set("tumor", "mesh", "path", to="t.nrrd"),
            r"mesh\.units is given for a segmentation; its unit is always mm",
        ),
        (_set("tumor", "mesh", to={"path": "t.stl"}), r"tumor\.mesh\.units is missing"),
        (
            _set("tumor", "mesh", to={"path": "t.nrrd", "segment": 1}),
            r"tumor\.mesh\.segment is 1; expected a text",
        ),
        (_set("tool", "mesh", "segment", to="T"), r"tool\.mesh\.segment is unknown"),
        (_set("tool", to=[]), r"tool is \[\]; expected a mapping"),
        (_set("tool", "frame", to="a b"), r"tool\.frame: frame name 'a b'"),
        (_set("tumor", "pose", "matrix", to=MATRIX[:12]), r"tumor\.pose\.matrix is 12 values"),
        (_set("tumor", "pose", "matrix", to=[2.0, *MATRIX[1:]]), r"tumor\.pose\.matrix: rotation"),
        (
            _set("tumor", "pose", "matrix", to=[-1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]),
            r"tumor\.pose\.matrix: .*reflection",
        ),
        (_set("tumor", "pose", "matrix", to=[*MATRIX[:15], 2.0]), r"last row"),
        (_set("tumor", "pose", "matrix", to=[float("nan"), *MATRIX[1:]]), r"matrix\[0\] is nan"),
        (
            _set("margins", "stop_mm", to=9.0),
            r"margins\.warn_mm is 5; expected more than stop_mm \(9\)",
        ),
        (
            _set("margins", "stop_mm", to=5.0),
            r"margins\.warn_mm is 5; expected more than stop_mm \(5\)",
        ),
        (
            _set("tumor", "frame", to="cautery"),
            r"tumor\.frame is 'cautery', the frame of the tool; expected",
        ),
        (_set("margins", "stop_mm", to=-1.0), r"margins\.stop_mm is -1; expected at least 0"),
        (_set("margins", "stop_mm", to="1"), r"margins\.stop_mm is '1'; expected a number"),
        (_set("margins", "stale_after_ms", to=0), r"margins\.stale_after_ms is 0"),
        (
            _set("margins", "release_samples", to=1.5),
            r"margins\.release_samples is 1\.5; expected an integer",
        ),
        (_set("recording", "sha256", to="abc"), r"recording\.sha256 is 'abc'; expected 64 hex"),
        (
            _set("provenance", "kind", to="real"),
            r"provenance\.kind is 'real'; expected one of simulated",
        ),
        (_set("clock", to={"estimate": True, "offset_robot_to_tracker_ms": 1}), r"clock\.estimate"),
        (_set("robot", to=ROBOT), r"registration is missing; expected one with a robot"),
        (
            _set("robot", to=ROBOT | {"joint_states": "x"}),
            r"robot\.joint_states is 'x'; expected a topic",
        ),
        (_set("registration", to={"method": "guess"}), r"registration\.method is 'guess'"),
        (_set("registration", to={"method": "given"}), r"registration\.matrix is missing"),
        (
            _set("registration", to={"method": "given", "matrix": MATRIX, "dwells": []}),
            r"registration\.dwells does not belong to given",
        ),
        (
            _set(
                "registration",
                to={"method": "paired_points", "fixed_mm": [[0, 0, 0]], "moving_mm": []},
            ),
            r"moving_mm has 0 points",
        ),
        (
            _set(
                "registration",
                to={"method": "paired_points", "fixed_mm": [[0, 0]], "moving_mm": []},
            ),
            r"fixed_mm\[0\] is 2 values",
        ),
        (
            _set(
                "registration",
                to={"method": "paired_points", "dwells": [{"start_s": 2.0, "end_s": 1.0}]},
            ),
            r"registration\.dwells\[0\]\.end_s is 1; expected a time after",
        ),
        (
            _set(
                "registration",
                to={
                    "method": "paired_points",
                    "dwells": [
                        {"start_s": 3.0, "end_s": 4.0},
                        {"start_s": 0.0, "end_s": 1.0},
                        {"start_s": 0.9, "end_s": 2.0},
                    ],
                },
            ),
            r"registration\.dwells overlap: 0\.9 to 2 s starts before 0 to 1 s has ended",
        ),
        (
            _set("registration", to={"method": "robot_world", "dwells": []}),
            r"registration\.dwells is empty; expected intervals",
        ),
        (
            _set(
                "registration",
                to={"method": "paired_points", "fixed_mm": [], "moving_mm": []},
            ),
            r"registration\.fixed_mm is empty; expected points",
        ),
    ],
)
def test_faults_are_refused_with_their_place(
    tmp_path: Path, manifest: dict[str, Any], edit: Edit, message: str
) -> None:
    edit(manifest)
    with pytest.raises(InputError, match=message) as caught:
        load(tmp_path, manifest)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "keys",
    [
        ("name",),
        ("margins", "k_tre"),
        ("margins", "v_max_mm_s"),
        ("margins",),
        ("tool",),
        ("tumor", "mesh"),
        ("provenance", "licence"),
        ("tool", "tip_from"),
    ],
)
def test_missing_required_keys_are_refused(
    tmp_path: Path, manifest: dict[str, Any], keys: tuple[str, ...]
) -> None:
    block = manifest
    for key in keys[:-1]:
        block = block[key]
    del block[keys[-1]]
    with pytest.raises(InputError, match=rf"{'.'.join(keys)} is missing".replace(".", r"\.")):
        load(tmp_path, manifest)


def test_folder_without_manifest_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"is not a case: it has no case\.yaml"):
        load_manifest(tmp_path)
