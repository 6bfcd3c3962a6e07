"""The stylus in the scene: at its calibrated tip while it is tracked, and absent otherwise."""

from dataclasses import replace

import numpy as np
import pytest

from app.fixture import MarginState
from app.geometry import TrackedTransform, Transform
from app.runtime import ShownItem
from app.scene.convert import world_matrix, world_points
from app.session.step_result import KnownEdges
from tests.scene.test_presenter import names
from tests.scene.test_presenter import present as present

pytestmark = pytest.mark.slow

TIP = Transform("pointer", "pointer_tip", np.eye(3), [2.0, -3.0, 120.0])
POSE = Transform("tracker", "pointer", np.eye(3), [40.0, 50.0, 60.0])


def stepped(step, *, tracked=True):
    known: dict[tuple[str, str], TrackedTransform | None] = {
        (each.target, each.source): each for each in step.frame.poses
    }
    if not tracked:
        known["tracker", "pointer"] = None
    return replace(step, edges=KnownEdges((), known))


@pytest.fixture
def calibrated(content):
    return replace(content, items=(ShownItem("stylus", "pointer").with_tip(TIP, 0.2),))


def stylus_node(presenter):
    return None if presenter.scene is None else presenter.scene.items.nodes.get("stylus")


def is_visible(presenter):
    node = stylus_node(presenter)
    return node is not None and bool(node.GetDisplayNode().GetVisibility())


def test_stylus_points_at_its_tip_while_it_is_tracked(
    application, present, calibrated, make_step, edges
):
    presenter = present(calibrated)
    presenter.show(stepped(make_step()))
    assert "StylusModel" not in names(application, "vtkMRMLModelNode")  # not tracked yet
    with_stylus = make_step(measured=(*edges, POSE))
    presenter.show(stepped(with_stylus))
    assert is_visible(presenter)
    node, scene = stylus_node(presenter), presenter.scene
    assert node.GetName() == "StylusModel"
    assert node.GetDisplayNode().GetColor() == ShownItem("stylus", "pointer").declared.color
    tip_node, sensor_node = scene.tree.node("pointer_tip"), scene.tree.node("pointer")
    tip, sensor = world_matrix(tip_node), world_matrix(sensor_node)
    np.testing.assert_allclose(tip, sensor @ TIP.matrix, atol=1e-9)
    # The point of the surface that is farthest along the tip's axis is the tip.
    along = (world_points(node) - tip[:3, 3]) @ tip[:3, 2]
    assert along.max() == pytest.approx(0.0, abs=1e-3)
    assert along.min() == pytest.approx(-np.linalg.norm(TIP.translation_mm), abs=1e-3)
    # A margin that is UNKNOWN says nothing on the stylus.
    presenter.show(stepped(make_step(MarginState.UNKNOWN, None, measured=(*edges, POSE))))
    assert is_visible(presenter)
    presenter.show(stepped(with_stylus, tracked=False))
    assert not is_visible(presenter)
    presenter.show(stepped(with_stylus))
    assert is_visible(presenter)
    presenter.hide_pointers()
    assert not is_visible(presenter)
    presenter.clear()
    assert "StylusModel" not in names(application, "vtkMRMLModelNode")


def test_stylus_without_a_tip_is_absent_and_follows_a_new_one(
    present, content, calibrated, make_step, edges
):
    content = replace(content, items=(ShownItem("stylus", "pointer"),))
    presenter = present(content)
    step = stepped(make_step(measured=(*edges, POSE)))
    presenter.show(step)
    assert stylus_node(presenter) is None
    presenter.set_content(calibrated)
    presenter.show(step)
    node = stylus_node(presenter)
    assert is_visible(presenter)
    longer = Transform("pointer", "pointer_tip", np.eye(3), [0.0, 0.0, 130.0])
    presenter.set_content(
        replace(content, items=(ShownItem("stylus", "pointer").with_tip(longer, 0.2),))
    )
    presenter.show(step)
    assert stylus_node(presenter) is node and node is not None
    axis = world_matrix(presenter.scene.tree.node("pointer_tip"))[:3, 2]
    assert np.ptp(world_points(node) @ axis) == pytest.approx(130.0, abs=1e-3)
