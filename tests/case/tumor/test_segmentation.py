import json
from pathlib import Path

import numpy as np
import pytest

from app.case.tumor import read_segment, surfaces, tumor_from_contour, tumor_from_segmentation
from app.fixture.meshes.mesh_checks import require_sound
from app.geometry import FloatArray, InputError, MeshError
from tests.case.tumor.conftest import segment_fields
from tests.refusals import refused

TWO = segment_fields(0, "Tumor") | segment_fields(1, "Node", label=2)


@pytest.mark.parametrize("name", ["Tumor", "Segment_1"])
def test_a_segment_by_name_and_by_identifier(write_nrrd, block, name):
    found = read_segment(write_nrrd(block, **TWO), name)
    assert found.name == "Tumor"
    assert found.marked.shape == (3, 3, 3)
    assert found.marked.all()
    assert not found.at_border
    # Index (1, 2, 3) of the file in LPS mm, converted to RAS.
    np.testing.assert_allclose(found.ras_from_index[:, 3], [-11.0, -24.0, 39.0])


def test_segment_of_a_plain_label_map_is_selected_by_value(write_nrrd, block):
    path = write_nrrd(block)
    found = read_segment(path, "2")
    assert found.marked.shape == (1, 1, 1)
    assert found.at_border
    with pytest.raises(InputError, match=r"holds 2 segments: 1, 2; expected the name of one"):
        read_segment(path, None)
    assert read_segment(write_nrrd(np.minimum(block, 1)), None).name == "1"


def test_box_cropped_by_slicer_does_not_count_as_border(write_nrrd, block):
    offset = {"Segmentation_ReferenceImageExtentOffset": "9 10 7"}
    assert not read_segment(write_nrrd(block, **TWO, **offset), "Node").at_border


def test_overlapping_segments_are_read_from_their_layers(write_nrrd, block):
    fields = segment_fields(0, "Tumor") | segment_fields(1, "Margin", layer=1)
    layers = np.stack([block == 1, np.ones_like(block)]).astype(np.uint8)
    directions = np.vstack([[np.nan] * 3, np.diag([1.0, 2.0, 3.0])])
    path = write_nrrd(layers, **fields, **{"space directions": directions})
    assert read_segment(path, "Tumor").marked.sum() == 27
    assert read_segment(path, "Margin").marked.sum() == block.size


@pytest.mark.parametrize(
    ("fields", "name", "message"),
    [
        (TWO, "Tumour", r"0 segments with the name 'Tumour'; .*: Tumor \(Segment_1\), Node \(Segm"),
        (TWO, None,
         r"holds 2 segments: Tumor \(Segment_1\), Node \(Segment_2\); expected the name of one"),
        (TWO | {"Segment1_Name": "Tumor"}, "Tumor",
         "2 segments with the name 'Tumor'; expected one of"),
        (TWO | {"Segment0_LabelValue": "7"}, "Tumor", "has no voxel"),
        (TWO | {"Segment0_LabelValue": "0"}, "Tumor",
         "value 0 of layer 0; expected a value other than 0"),
        (TWO | {"Segment0_LabelValue": "x"}, "Tumor", "Segment0 is .*invalid literal"),
        (TWO | {"Segment0_Layer": "1"}, "Tumor", "a layer from 0 to 0"),
        (TWO | {"Segment0_Layer": "-1"}, "Tumor", "a layer from 0 to 0"),
        ({"Segment0_Name": "Tumor"}, "Tumor", "Segment0_ID is missing: Slicer writes it since"),
        (TWO | {"Segmentation_MasterRepresentation": "Fractional labelmap"}, "Tumor",
         "is 'Fractional labelmap'; expected 'Binary labelmap'"),
        ({}, "3", "0 segments with the name '3'; expected one of: 1, 2"),
    ],
)  # fmt: skip
def test_missing_segments_are_refused(write_nrrd, block, fields, name, message):
    with refused(message):
        read_segment(write_nrrd(block, **fields), name)


def test_empty_label_map_and_image_are_refused(write_nrrd, block):
    with pytest.raises(InputError, match="holds 0 segments: none; expected the name of one"):
        read_segment(write_nrrd(np.zeros_like(block)), None)
    image = np.arange(1000, dtype=np.int16).reshape(10, 10, 10)
    with pytest.raises(InputError, match=r"999 different values .* up to 256, not an image"):
        read_segment(write_nrrd(image), None)
    directions = np.vstack([[np.nan] * 3, np.diag([1.0, 2.0, 3.0])])
    with pytest.raises(InputError, match="2 layers and no segment names"):
        read_segment(write_nrrd(np.stack([block] * 2), **{"space directions": directions}), "1")


def test_hollows_parts_and_borders_are_noted(write_nrrd):
    voxels = np.zeros((12, 12, 12), dtype=np.uint8)
    voxels[1:6, 1:6, 1:6] = 1
    voxels[3, 3, 3] = 0
    voxels[8:, 8:10, 8:10] = 1
    built = tumor_from_segmentation(write_nrrd(voxels), frame="tumor", segment="1")
    require_sound(built.mesh, "the tumour")
    assert built.notes == (
        "the tumour is segment '1' of labels.nrrd, 140 voxels",
        "1 voxels that the segment encloses count as tumour",
        "the segment has 2 parts that do not touch",
        "the segment reaches the border of its volume: it may go on beyond",
    )
    assert built.mesh.signed_volume_mm3 == pytest.approx(141 * 6.0, rel=0.01)


def contour(folder: Path, points: FloatArray, **changes: object) -> Path:
    """A point list as 3D Slicer writes it: all labels equal, in LPS."""
    markup = {
        "type": "Fiducial",
        "coordinateSystem": "LPS",
        "coordinateUnits": "mm",
        "controlPoints": [{"label": "T", "position": point} for point in points.tolist()],
    } | changes
    path = folder / "contour.mrk.json"
    path.write_text(json.dumps({"markups": [markup]}))
    return path


def test_a_contour_in_lps_becomes_a_tumour_in_ras(tmp_path):
    directions = np.random.default_rng(5).normal(size=(30, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = directions * 10.0 + [20.0, 30.0, 40.0]
    built = tumor_from_contour(contour(tmp_path, points), frame="tumor")
    low, high = require_sound(built.mesh, "the tumour").bounds_mm
    np.testing.assert_allclose((low + high) / 2.0, [-20.0, -30.0, 40.0], atol=1.0)
    assert built.notes == ("the tumour is the rounded convex hull of 30 points",)


def test_the_file_is_named_in_errors(tmp_path, write_nrrd, block, monkeypatch):
    with pytest.raises(MeshError, match=r"contour\.mrk\.json: 3 contoured points"):
        tumor_from_contour(contour(tmp_path, np.eye(3)), frame="tumor")
    metres = contour(tmp_path, np.eye(3), coordinateUnits="m")
    with refused(r"contour\.mrk\.json: coordinateUnits is 'm'; expected mm"):
        tumor_from_contour(metres, frame="tumor")
    monkeypatch.setattr(surfaces, "MAX_VOXELS", 100)
    with pytest.raises(MeshError, match=r"labels\.nrrd: the marked voxels span 3 x 3 x 3"):
        tumor_from_segmentation(write_nrrd(block), frame="tumor", segment="1")
