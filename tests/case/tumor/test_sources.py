import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from app.case.tumor import label_surface, tumor_from_contour, tumor_from_segmentation
from app.fixture.meshes.mesh_checks import require_sound
from app.geometry import FloatArray, InputError, MeshError

WriteNrrd = Callable[..., Path]
Volume = NDArray[Any]


def test_hollows_parts_and_borders_are_noted(write_nrrd: WriteNrrd) -> None:
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


def test_a_contour_in_lps_becomes_a_tumour_in_ras(tmp_path: Path) -> None:
    directions = np.random.default_rng(5).normal(size=(30, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = directions * 10.0 + [20.0, 30.0, 40.0]
    built = tumor_from_contour(contour(tmp_path, points), frame="tumor")
    low, high = require_sound(built.mesh, "the tumour").bounds_mm
    np.testing.assert_allclose((low + high) / 2.0, [-20.0, -30.0, 40.0], atol=1.0)
    assert built.notes == ("the tumour is the rounded convex hull of 30 points",)


def test_the_file_is_named_in_errors(
    tmp_path: Path, write_nrrd: WriteNrrd, block: Volume, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(MeshError, match=r"contour\.mrk\.json: 3 contoured points"):
        tumor_from_contour(contour(tmp_path, np.eye(3)), frame="tumor")
    with pytest.raises(
        InputError, match=r"contour\.mrk\.json: coordinateUnits is 'm'; expected mm"
    ):
        tumor_from_contour(contour(tmp_path, np.eye(3), coordinateUnits="m"), frame="tumor")
    monkeypatch.setattr(label_surface, "MAX_VOXELS", 100)
    with pytest.raises(MeshError, match=r"labels\.nrrd: the marked voxels span 3 x 3 x 3"):
        tumor_from_segmentation(write_nrrd(block), frame="tumor", segment="1")
