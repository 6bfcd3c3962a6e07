"""The ultrasound image in the panel: its place against the page's, a slice view, freeze, depth."""

import numpy as np
import pytest
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.case import open_case_images
from app.geometry import InputError, image_corners
from app.runtime import prepare_case
from app.scene.convert import world_matrix
from app.scene.image_nodes import TRANSFORM_NAME, VOLUME_NAME
from app.session import BreachList
from tests.case.images.sequences import some_pixels
from tests.case.images.ultrasound_case import (
    COLUMNS,
    INVALID,
    LOST,
    PIXEL_MM,
    ROWS,
    write_ultrasound_case,
)
from tests.cli.small_case import FRAMES
from tests.slicer_module.marginguard_module import RecordedCase, node_of, spin_until, step

pytestmark = pytest.mark.slow

FIRST = 2


@pytest.fixture
def panel_logic(unconnected):
    return unconnected


def shown_image(logic, number):
    """Show the moment of image ``number`` of the case."""
    spin_until(logic, lambda now: now.position_s is not None)
    while logic.refresh().ultrasound.text != f"image {number}":
        step(logic)


def corners(application):
    """Corner pixels (4, 3) in mm of the world, by the nodes alone."""
    node = node_of(application, VOLUME_NAME)
    columns, rows, _ = node.GetImageData().GetDimensions()
    ijk = vtkMatrix4x4()
    node.GetIJKToRASMatrix(ijk)
    to_local = np.array([[ijk.GetElement(r, c) for c in range(4)] for r in range(4)])
    to_world = world_matrix(node.GetParentTransformNode()) @ to_local
    ends = [(0, 0), (columns - 1, 0), (columns - 1, rows - 1), (0, rows - 1)]
    return np.array([(to_world @ (c, r, 0, 1))[:3] for c, r in ends])


def slice_view(application, name="Red"):
    view = application.scene.AddNewNodeByClass("vtkMRMLSliceNode")
    view.SetLayoutName(name)
    composite = application.scene.AddNewNodeByClass("vtkMRMLSliceCompositeNode")
    composite.SetLayoutName(name)
    return view, composite


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    return prepare_case(write_ultrasound_case(tmp_path_factory.mktemp("images") / "case"))


@pytest.fixture
def case_folder(opened, monkeypatch):
    """Folder of a case that the panel opens without a delay."""
    monkeypatch.setattr(
        "MarginGuardLib.logic.prepare_recorded",
        lambda folder: RecordedCase(opened, BreachList(), open_case_images(opened.case)),
    )
    return opened.case.folder


def test_image_of_a_replay_is_where_the_page_shows_it_with_its_pixels(
    panel_logic, application, opened
):
    view, composite = slice_view(application)
    slice_view(application, "Yellow")
    panel_logic.load_case(opened.case.folder)
    spin_until(panel_logic, lambda now: now.ultrasound.text.startswith("image"))
    panel_logic.ultrasound.follow(True)
    images = open_case_images(opened.case)
    for number in (FIRST, FIRST + 2):
        shown_image(panel_logic, number)
        scene = panel_logic.session.display.scene
        now_ns = panel_logic.session.shown_step.frame.stamp.ns
        found = images.at(now_ns, scene.reference)
        root = world_matrix(scene.tree.node(scene.reference))
        expected = image_corners(root @ found.pose.matrix, COLUMNS, ROWS)
        np.testing.assert_allclose(corners(application), expected, rtol=0, atol=1e-6)
        node = node_of(application, VOLUME_NAME)
        assert node.GetClassName() == "vtkMRMLScalarVolumeNode"
        assert node.GetParentTransformNode().GetName() == TRANSFORM_NAME
        assert composite.GetBackgroundVolumeID() == node.GetID()
        assert panel_logic.ultrasound.pixel_mm == pytest.approx((PIXEL_MM, PIXEL_MM))
        values = vtk_to_numpy(node.GetImageData().GetPointData().GetScalars())
        pixels = some_pixels(FRAMES, ROWS, COLUMNS)[number]
        np.testing.assert_array_equal(values.reshape(ROWS, COLUMNS), pixels)
        # The slice: to the right along the columns, up against the rows, its middle the image's.
        slice_to_ras = view.GetSliceToRAS()
        axes = np.array([[slice_to_ras.GetElement(r, c) for c in range(4)] for r in range(3)])
        first, right, last, below = expected
        np.testing.assert_allclose(axes[:, 3], (first + last) / 2.0, rtol=0, atol=1e-6)
        unit = (right - first) / np.linalg.norm(right - first)
        np.testing.assert_allclose(axes[:, 0], unit, rtol=0, atol=1e-9)
        assert axes[:, 1] @ (first - below) == pytest.approx(np.linalg.norm(first - below))
    images.close()


@pytest.mark.parametrize(
    ("number", "problem"), [(INVALID, "has status INVALID"), (LOST, "probe is OUT_OF_VIEW")]
)
def test_image_that_is_not_current_has_no_pixels_in_the_scene(
    panel_logic, application, case_folder, number, problem
):
    panel_logic.load_case(case_folder)
    shown_image(panel_logic, number - 1)
    assert node_of(application, VOLUME_NAME).GetImageData() is not None
    panel_logic.step()
    status = spin_until(panel_logic, lambda now: now.ultrasound.text.startswith("NO CURRENT"))
    assert problem in status.ultrasound.text
    assert node_of(application, VOLUME_NAME).GetImageData() is None
    with pytest.raises(InputError, match="expected a current one"):
        panel_logic.ultrasound.freeze(True)
    shown_image(panel_logic, number + 1)
    assert node_of(application, VOLUME_NAME).GetImageData() is not None


def test_frozen_image_stays_in_the_frame_that_the_tumour_moves_with(
    panel_logic, application, case_folder
):
    panel_logic.load_case(case_folder)
    shown_image(panel_logic, FIRST)
    before = corners(application)
    panel_logic.ultrasound.freeze(True)
    np.testing.assert_allclose(corners(application), before, rtol=0, atol=1e-6)
    node = node_of(application, TRANSFORM_NAME)
    frame = panel_logic.session.started().content.frame_from_tumor.target
    assert node.GetParentTransformNode() is panel_logic.session.display.frame_node(frame)
    status = step(panel_logic)
    assert status.ultrasound.text == f"FROZEN: not current, image {FIRST}"
    panel_logic.ultrasound.freeze(False)
    assert panel_logic.refresh().ultrasound.text == f"image {FIRST + 1}"
    panel_logic.end_session()
    assert node_of(application, VOLUME_NAME) is None
    assert node_of(application, TRANSFORM_NAME) is None


def test_slice_view_that_does_not_exist_is_refused(panel_logic):
    with pytest.raises(InputError, match="the scene has no slice view Red; expected one"):
        panel_logic.ultrasound.follow(True)
