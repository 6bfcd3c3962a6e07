"""Pixels of a small view of each state, with all nodes of the scene."""

import numpy as np
import pytest
from slicer import vtkMRMLScene

from app.fixture import MarginState, constrain, margin_surface
from app.geometry import Stamp, Transform
from app.scene import MarginGuardScene, SceneApplication, bullseye, forward_of, offscreen_view
from app.scene.convert import world_matrix, world_points
from app.scene.pictures.camera_views import fit
from tests.scene.scene_content import set_poses

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("can_draw")]
NOW_NS, STALE_NS = 10**12, 200_000_000


def ratio(pixels, of):
    """Pixels in which channel ``of`` stands out by 30 %."""
    others = np.delete(pixels.astype(int), of, axis=-1).max(axis=-1)
    return int((10 * pixels[..., of].astype(int) > 13 * others).sum())


def test_states_are_visible_through_the_margin_surface_and_stale_is_grey(tumor, fill, decision):
    application = SceneApplication(vtkMRMLScene())
    scene = MarginGuardScene(application.scene, logic=application.logic, stale_after_ns=STALE_NS)
    fill(scene, has_robot=False).add_margin_surface(margin_surface(tumor, 3.0, spacing_mm=1.0))
    points = world_points(scene.margin_surface)

    def clear(now_ns):
        near = decision(MarginState.NEGATIVE, 2.0)
        constraint = constrain(near.proximity, 1.0, frame="tumor")
        return near._replace(constraint=constraint, constraint_is_current=True, stamp=Stamp(now_ns))

    with offscreen_view(application, "States", (200, 200)) as view:
        view.look(fit(points, np.eye(3)[0], np.eye(3)[2], angle_deg=30.0, aspect=1.0))
        scene.show(clear(NOW_NS), {}, NOW_NS)
        green = view.pixels()
        assert ratio(green, 1) > 8000 and ratio(green, 0) == 0
        scene.check(NOW_NS + STALE_NS + 1)
        grey = view.pixels()
        assert ratio(grey, 1) == ratio(grey, 0) == ratio(grey, 2) == 0
        middle = grey[80:120, 80:120].astype(int)
        assert np.ptp(middle, axis=-1).max() < 25
        scene.show(decision(MarginState.POSITIVE, -3.0)._replace(stamp=Stamp(0)), {}, 0)
        red = view.pixels()
        assert ratio(red, 0) > 8000 and ratio(red, 1) == 0
        # Grey again, but the breach mark is still visible.
        scene.check(NOW_NS)
        marked = np.abs(view.pixels().astype(int) - grey).max(axis=-1) > 20
        assert 10 < marked.sum() < 1000


def test_bullseye_shows_the_tip_in_the_middle(tumor, tool, edges, fixed):
    application = SceneApplication(vtkMRMLScene())
    scene = MarginGuardScene(application.scene)
    set_poses(scene, edges, fixed)
    scene.add_tool(tool)
    ras_from_tip = Transform.from_matrix(
        world_matrix(scene.tree.node("cautery_tip")), target="ras", source="cautery_tip"
    )
    with offscreen_view(application, "Bullseye", (160, 160)) as view:
        view.look(bullseye(ras_from_tip, forward_of(tool), distance_mm=150.0))
        pixels = view.pixels().astype(int)
    tool_rows, tool_columns = np.nonzero(pixels[..., 0] > pixels[..., 2] + 60)
    # A square rod of 2 mm from behind, its nearest end 90 mm away: some 6 pixels wide.
    for places in (tool_rows, tool_columns):
        assert places.mean() == pytest.approx(79.5, abs=1.0)
        assert 4 <= np.ptp(places) <= 10


def test_closed_view_leaves_no_node():
    scene = SceneApplication(vtkMRMLScene())
    before = scene.scene.GetNumberOfNodes()
    for _ in range(2):
        with offscreen_view(scene, "Closed", (40, 30)) as view:
            view.pixels()
        assert scene.scene.GetNumberOfNodes() == before
