"""Order of translucent surfaces, beside VTK's exact depth peeling."""

import numpy as np
import pytest

from app.viewer import SceneView
from app.viewer.drawing.camera_controller import CameraController, CameraPreset
from app.viewer.drawing.render_loop import PictureArea
from app.viewer.drawing.scene_view import Part

pytestmark = pytest.mark.slow

VIEWS = (CameraPreset.CLOSE, CameraPreset.SIDE)


@pytest.fixture(scope="module")
def view(can_draw, parts):
    return SceneView(parts.content)


@pytest.fixture(scope="module")
def area(view):
    area = PictureArea(view.view)
    area.process_resize_event(400, 300)
    area.take_resized()
    return area


def shown(view, parts, frame, preset):
    view.show(parts.feed.shown[frame])
    camera = CameraController(view)
    camera.select(preset)
    camera.update()
    view.sort()


def pixels(area):
    return area.img_cols_rows[0].astype(int)


def peeled(view, area):
    renderer = view.view.renderer()
    renderer.SetUseDepthPeeling(True)
    try:
        return pixels(area)
    finally:
        renderer.SetUseDepthPeeling(False)


@pytest.mark.parametrize("preset", VIEWS)
def test_ordered_picture_is_near_the_exact_one(view, area, parts, preset):
    area.set_high_quality(False)
    shown(view, parts, 0, preset)
    for model in (view.scene.tumor, view.scene.margin_surface):
        # Only depth peeling adds highlights above the brightest colour.
        model.GetDisplayNode().SetSpecular(0.0)
    view.sort()
    exact, ordered = peeled(view, area), pixels(area)
    assert not view.view.renderer().GetUseOIT()
    view.order.update(view.scene, ())  # none is known to be closed: VTK sorts
    assert view.view.renderer().GetUseOIT()
    view.view.renderer().SetUseOIT(False)
    unsorted = pixels(area)
    wrong = [np.abs(each - exact).max(axis=2) for each in (ordered, unsorted)]
    assert wrong[0].mean() < 0.3 * wrong[1].mean()
    assert (wrong[0] > 16).mean() < 0.002


def test_second_translucent_part_is_left_to_vtk(view, parts):
    shown(view, parts, 0, CameraPreset.CLOSE)
    tool, tumor = (node.GetDisplayNode() for node in (view.scene.tool, view.scene.tumor))
    actors = view.view.renderer().GetViewProps().GetNumberOfItems()
    assert (tool.GetBackfaceCulling(), tumor.GetFrontfaceCulling()) == (1, 1)
    view.set_opacity(Part.TOOL, 0.5)
    view.order.update(view.scene, {view.scene.tumor, view.scene.margin_surface})
    assert view.view.renderer().GetUseOIT()
    assert (tool.GetBackfaceCulling(), tumor.GetFrontfaceCulling()) == (0, 0)
    view.set_opacity(Part.TOOL, 1.0)
    view.sort()
    assert not view.view.renderer().GetUseOIT()
    assert view.view.renderer().GetViewProps().GetNumberOfItems() == actors


def test_hidden_tumour_has_no_near_side(view, parts):
    shown(view, parts, 0, CameraPreset.CLOSE)
    count = view.view.renderer().GetViewProps().GetNumberOfItems()
    view.set_visible(Part.TUMOR, False)
    view.sort()
    assert view.view.renderer().GetViewProps().GetNumberOfItems() == count - 1
    view.set_visible(Part.TUMOR, True)
    view.sort()


def test_grey_of_an_unknown_state_reaches_both_sides(view, area, parts):
    shown(view, parts, 0, CameraPreset.CLOSE)
    colored = pixels(area)
    view.show(parts.feed.shown[0].as_unknown("the session has failed"))
    view.sort()
    grey = pixels(area)
    assert np.abs(colored - grey).max() > 40
    at = np.unravel_index(np.abs(colored - grey).sum(axis=2).argmax(), grey.shape[:2])
    assert np.ptp(grey[at]) < 25  # no colour
