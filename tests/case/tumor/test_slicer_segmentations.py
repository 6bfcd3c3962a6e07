"""Positions of voxels in segmentations that 3D Slicer writes and reads."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from app.case.tumor import read_segment, tumor_from_segmentation
from app.fixture.meshes.mesh_checks import require_sound
from tests.case.tumor.conftest import segment_fields

slicer = pytest.importorskip("slicer")
vtk = pytest.importorskip("vtk")
vtk_to_numpy = pytest.importorskip("vtkmodules.util.numpy_support").vtk_to_numpy

Volume = NDArray[Any]

SHAPE, SIDES = (40, 38, 24), np.array([0.8, 0.9, 1.6])
TURNED = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix()
ORIGIN_RAS = np.array([30.0, -40.0, 70.0])
CENTRES_RAS = np.moveaxis(np.indices(SHAPE), 0, -1) * SIDES @ TURNED.T + ORIGIN_RAS
MIDDLE = CENTRES_RAS[20, 19, 12]
BALLS = {"Tumor": (MIDDLE, 9.0), "Näher dran": (np.add(MIDDLE, [4.0, 0.0, 0.0]), 5.0)}


def in_slicer(marked: Volume) -> Any:
    """Marks of `SHAPE` as an image of Slicer, placed in RAS by Slicer's own matrix."""
    image = slicer.vtkOrientedImageData()
    image.SetDimensions(*marked.shape)
    image.AllocateScalars(vtk.VTK_UNSIGNED_CHAR, 1)
    vtk_to_numpy(image.GetPointData().GetScalars())[:] = marked.ravel(order="F")
    world_from_index = np.eye(4)
    world_from_index[:3, :3], world_from_index[:3, 3] = TURNED * SIDES, ORIGIN_RAS
    matrix = vtk.vtkMatrix4x4()
    matrix.DeepCopy(world_from_index.ravel())
    image.SetImageToWorldMatrix(matrix)
    return image


def ball(name: str) -> NDArray[np.bool_]:
    middle, radius = BALLS[name]
    return np.asarray(np.linalg.norm(CENTRES_RAS - middle, axis=-1) < radius)


@pytest.mark.parametrize("names", [["Tumor"], ["Tumor", "Näher dran"]], ids=["shared", "layers"])
@pytest.mark.parametrize("compressed", [True, False])
def test_segmentation_of_slicer_is_read_at_its_position(tmp_path, names, compressed):
    scene = slicer.vtkMRMLScene()
    node = scene.AddNewNodeByClass("vtkMRMLSegmentationNode")
    for name in names:
        image = in_slicer(ball(name))
        node.AddSegmentFromBinaryLabelmapRepresentation(image, name, [1.0, 0.0, 0.0])
    storage = slicer.vtkMRMLSegmentationStorageNode()
    scene.AddNode(storage)
    path = tmp_path / "tumour.seg.nrrd"
    storage.SetFileName(str(path))
    storage.SetUseCompression(compressed)
    assert storage.WriteData(node)
    for name in names:
        middle, radius = BALLS[name]
        built = tumor_from_segmentation(
            path, frame="tumor", segment=name if len(names) > 1 else None
        )
        mesh = require_sound(built.mesh, "the tumour")
        off = np.linalg.norm(mesh.vertices_mm - middle, axis=1) - radius
        assert np.abs(off).max() < 0.6 * SIDES.max()
        voxels = int(ball(name).sum())
        assert built.notes == (
            f"the tumour is segment {name!r} of tumour.seg.nrrd, {voxels} voxels",
        )


def test_slicer_reads_the_files_of_these_tests_at_the_same_position(write_nrrd, block):
    fields = segment_fields(0, "Tumor") | segment_fields(1, "Node", label=2)
    path = write_nrrd(block, name="labels.seg.nrrd", **fields)
    scene = slicer.vtkMRMLScene()
    node = scene.AddNewNodeByClass("vtkMRMLSegmentationNode")
    storage = slicer.vtkMRMLSegmentationStorageNode()
    scene.AddNode(storage)
    storage.SetFileName(str(path))
    assert storage.ReadData(node)
    slicer_map = slicer.vtkOrientedImageData()
    assert node.GetBinaryLabelmapRepresentation("Segment_1", slicer_map)
    values = vtk_to_numpy(slicer_map.GetPointData().GetScalars()).reshape(
        slicer_map.GetDimensions(), order="F"
    )
    ras_from_index = vtk.vtkMatrix4x4()
    slicer_map.GetImageToWorldMatrix(ras_from_index)
    first = np.array(slicer_map.GetExtent()[::2])
    marked = [[*(index + first), 1.0] for index in np.argwhere(values)]
    slicer_points = np.array([ras_from_index.MultiplyPoint(index)[:3] for index in marked])
    assert len(slicer_points) == 27
    read = read_segment(path, "Tumor")
    indices = np.argwhere(read.marked)
    np.testing.assert_allclose(
        np.unique(indices @ read.ras_from_index[:, :3].T + read.ras_from_index[:, 3], axis=0),
        np.unique(slicer_points, axis=0),
        atol=1e-9,
    )
