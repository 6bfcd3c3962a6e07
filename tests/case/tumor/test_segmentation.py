from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from app.case.tumor import read_segment
from app.geometry import InputError
from tests.case.tumor.conftest import segment_fields

WriteNrrd = Callable[..., Path]
Volume = NDArray[Any]

TWO = segment_fields(0, "Tumor") | segment_fields(1, "Node", label=2)


@pytest.mark.parametrize("name", ["Tumor", "Segment_1"])
def test_a_segment_by_name_and_by_identifier(
    write_nrrd: WriteNrrd, block: Volume, name: str
) -> None:
    found = read_segment(write_nrrd(block, **TWO), name)
    assert found.name == "Tumor"
    assert found.marked.shape == (3, 3, 3)
    assert found.marked.all()
    assert not found.at_border
    # Index (1, 2, 3) of the file in LPS mm, converted to RAS.
    np.testing.assert_allclose(found.ras_from_index[:, 3], [-11.0, -24.0, 39.0])


def test_segment_of_a_plain_label_map_is_selected_by_value(
    write_nrrd: WriteNrrd, block: Volume
) -> None:
    path = write_nrrd(block)
    found = read_segment(path, "2")
    assert found.marked.shape == (1, 1, 1)
    assert found.at_border
    with pytest.raises(InputError, match=r"holds 2 segments: 1, 2; expected the name of one"):
        read_segment(path, None)
    assert read_segment(write_nrrd(np.minimum(block, 1)), None).name == "1"


def test_box_cropped_by_slicer_does_not_count_as_border(
    write_nrrd: WriteNrrd, block: Volume
) -> None:
    offset = {"Segmentation_ReferenceImageExtentOffset": "9 10 7"}
    assert not read_segment(write_nrrd(block, **TWO, **offset), "Node").at_border


def test_overlapping_segments_are_read_from_their_layers(
    write_nrrd: WriteNrrd, block: Volume
) -> None:
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
        (
            TWO,
            None,
            r"holds 2 segments: Tumor \(Segment_1\), Node \(Segment_2\); expected the name of one",
        ),
        (
            TWO | {"Segment1_Name": "Tumor"},
            "Tumor",
            "2 segments with the name 'Tumor'; expected one of",
        ),
        (TWO | {"Segment0_LabelValue": "7"}, "Tumor", "has no voxel"),
        (
            TWO | {"Segment0_LabelValue": "0"},
            "Tumor",
            "value 0 of layer 0; expected a value other than 0",
        ),
        (TWO | {"Segment0_LabelValue": "x"}, "Tumor", "Segment0 is .*invalid literal"),
        (TWO | {"Segment0_Layer": "1"}, "Tumor", "a layer from 0 to 0"),
        (TWO | {"Segment0_Layer": "-1"}, "Tumor", "a layer from 0 to 0"),
        ({"Segment0_Name": "Tumor"}, "Tumor", "Segment0_ID is missing: Slicer writes it since"),
        (
            TWO | {"Segmentation_MasterRepresentation": "Fractional labelmap"},
            "Tumor",
            "is 'Fractional labelmap'; expected 'Binary labelmap'",
        ),
        ({}, "3", "0 segments with the name '3'; expected one of: 1, 2"),
    ],
)
def test_missing_segments_are_refused(
    write_nrrd: WriteNrrd,
    block: Volume,
    fields: dict[str, str],
    name: str | None,
    message: str,
) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read_segment(write_nrrd(block, **fields), name)
    assert "\n" not in str(caught.value)


def test_empty_label_map_and_image_are_refused(write_nrrd: WriteNrrd, block: Volume) -> None:
    with pytest.raises(InputError, match="holds 0 segments: none; expected the name of one"):
        read_segment(write_nrrd(np.zeros_like(block)), None)
    image = np.arange(1000, dtype=np.int16).reshape(10, 10, 10)
    with pytest.raises(InputError, match=r"999 different values .* up to 256, not an image"):
        read_segment(write_nrrd(image), None)
    directions = np.vstack([[np.nan] * 3, np.diag([1.0, 2.0, 3.0])])
    with pytest.raises(InputError, match="2 layers and no segment names"):
        read_segment(write_nrrd(np.stack([block] * 2), **{"space directions": directions}), "1")
