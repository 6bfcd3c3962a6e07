"""Contour of a tumour in the panel: Slicer's markups, points at the tip, surface, acceptance."""

from dataclasses import replace

import numpy as np
import pytest

from app.contour import MAX_POINTS, Contour, ContourPoint, contour_surface
from app.geometry import InputError
from tests.shipped_case import DEEP, middle_s
from tests.slicer_module.marginguard_module import CLEAR_S, node_of, show, spin_until

from MarginGuardLib.contour import NAME  # isort: skip

pytestmark = pytest.mark.slow

RADIUS_MM = 9.0
ERROR_MM = 0.3


@pytest.fixture
def panel_logic(replayed):
    show(replayed, CLEAR_S)
    return replayed


def edge(panel_logic):
    return panel_logic.session.started().content.frame_from_tumor


def ball(panel_logic, count=40):
    """Points (n, 3) on a ball around the middle of the tumour, in the frame it moves with."""
    turn = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0))
    z = 1.0 - 2.0 * (np.arange(count) + 0.5) / count
    around = np.sqrt(1.0 - z**2)
    middle_mm = edge(panel_logic).apply(panel_logic.session.started().content.tumor.centroid_mm)
    return middle_mm + RADIUS_MM * np.stack([around * np.cos(turn), around * np.sin(turn), z], 1)


def click(node, points_mm):
    """Place points as Slicer's mouse mode does."""
    for point in points_mm.tolist():
        node.AddControlPoint(point)


def placed(panel_logic, application):
    panel_logic.contour.place()
    node = node_of(application, NAME)
    click(node, ball(panel_logic))
    return node


def tip_mm(panel_logic):
    step = panel_logic.session.shown_step
    return (edge(panel_logic) @ step.tumor_from_tip).translation_mm


def test_clicks_of_slicer_become_the_surface_of_the_page(panel_logic, application):
    node = placed(panel_logic, application)
    assert application.logic.GetSelectionNode().GetActivePlaceNodeID() == node.GetID()
    interaction = application.logic.GetInteractionNode()
    assert interaction.GetCurrentInteractionMode() == interaction.Place
    frame = edge(panel_logic).target
    assert node.GetParentTransformNode() is panel_logic.session.display.frame_node(frame)
    panel_logic.contour.set_options(2.0, ERROR_MM, 0.0)
    status = spin_until(panel_logic, lambda now: now.contour.can_use)
    points = tuple(ContourPoint(n, each) for n, each in enumerate(ball(panel_logic), 1))
    expected = contour_surface(Contour(frame, points, 2.0, ERROR_MM), 0.0)
    lines = status.contour.text.splitlines()
    assert lines[0] == "40 points"
    assert lines[1].startswith(f"{expected.mesh.signed_volume_mm3 / 1000.0:.2f} cm")
    assert f"{expected.uncertainty.sigma_mm:.2f} mm: calibration 0.30" in lines[2]
    surface = node_of(application, "Contour").GetPolyData()
    assert surface.GetNumberOfPoints() == len(expected.mesh.vertices_mm)


def test_accepted_contour_is_the_tumour_of_the_session_with_its_uncertainty(
    panel_logic, application
):
    points_mm = ball(panel_logic)
    node = placed(panel_logic, application)
    spin_until(panel_logic, lambda now: "cm" in now.contour.text)
    with pytest.raises(InputError, match="the error of its points is not stated"):
        panel_logic.contour.use()
    panel_logic.contour.set_options(0.0, ERROR_MM, 0.0)
    with pytest.raises(InputError, match="its surface is being computed"):
        panel_logic.contour.use()
    spin_until(panel_logic, lambda now: now.contour.can_use)
    before = panel_logic.session.started().content
    panel_logic.contour.use()
    spin_until(
        panel_logic, lambda now: panel_logic.session.started().content.tumor is not before.tumor
    )
    content = panel_logic.session.started().content
    assert content.tumor_sigma_mm > ERROR_MM
    in_frame = content.tumor.transformed(edge(panel_logic))
    inside = 4.0 / 3.0 * np.pi * RADIUS_MM**3
    assert inside * 0.85 < in_frame.signed_volume_mm3 < inside * 1.15
    panel_logic.step()
    status = spin_until(panel_logic, lambda now: "hold: tumour replaced" in now.reasons)
    assert "set_tumor from the panel accepted" in status.request
    # The display was made anew: points and surface are in its frame.
    frame_node = panel_logic.session.display.frame_node(edge(panel_logic).target)
    spin_until(panel_logic, lambda now: node.GetParentTransformNode() is frame_node)
    np.testing.assert_allclose(panel_logic.contour._points.positions_mm, points_mm, atol=1e-6)


def test_points_at_the_tip_are_erased_and_restored(panel_logic, application):
    panel_logic.contour.add_tip()
    first_mm = tip_mm(panel_logic)
    points = panel_logic.contour._points
    np.testing.assert_allclose(points.positions_mm, [first_mm], atol=1e-6)
    show(panel_logic, middle_s(DEEP))
    panel_logic.contour.add_tip()
    np.testing.assert_allclose(points.positions_mm, [first_mm, tip_mm(panel_logic)], atol=1e-6)
    status = spin_until(panel_logic, lambda now: "2 points; expected 4" in now.contour.text)
    assert not status.contour.can_use
    with pytest.raises(InputError, match="2 points; expected 4"):
        panel_logic.contour.use()
    panel_logic.contour.erase_at_tip(2.0)
    np.testing.assert_allclose(points.positions_mm, [first_mm], atol=1e-6)
    panel_logic.contour.undo()
    assert len(points.positions_mm) == 2
    panel_logic.contour.delete_all()
    assert len(points.positions_mm) == 0
    for count in (2, 1, 0):
        panel_logic.contour.undo()
        assert len(points.positions_mm) == count
    with pytest.raises(InputError, match="there is no change to undo"):
        panel_logic.contour.undo()


def test_deletion_of_a_point_in_slicer_is_undone(panel_logic, application):
    node = placed(panel_logic, application)
    node.RemoveNthControlPoint(3)
    points = panel_logic.contour._points
    assert len(points.positions_mm) == 39
    panel_logic.contour.undo()
    np.testing.assert_allclose(points.positions_mm, ball(panel_logic), atol=1e-6)
    panel_logic.contour.undo()
    assert len(points.positions_mm) == 39  # the last click


def test_deleted_node_and_ended_session_leave_nothing(panel_logic, application):
    node = placed(panel_logic, application)
    spin_until(panel_logic, lambda now: "cm" in now.contour.text)
    application.scene.RemoveNode(node)
    status = spin_until(panel_logic, lambda now: not now.contour.has_points)
    assert status.contour.text == ""
    assert node_of(application, "Contour") is None
    placed(panel_logic, application)
    spin_until(panel_logic, lambda now: "cm" in now.contour.text)
    panel_logic.end_session()
    assert node_of(application, NAME) is None
    assert node_of(application, "Contour") is None
    with pytest.raises(InputError, match="there is no session"):
        panel_logic.contour.place()


def test_too_many_points_and_an_unknown_tip_are_refused(panel_logic):
    panel_logic.contour.add_tip()
    points = panel_logic.contour._points
    with pytest.raises(InputError, match="301 points; expected at most 300"):
        points.replace(np.zeros((MAX_POINTS + 1, 3)))
    panel_logic.session._last = replace(
        panel_logic.session._last, step=replace(panel_logic.session.shown_step, tumor_from_tip=None)
    )
    with pytest.raises(InputError, match="the tip's place is UNKNOWN"):
        panel_logic.contour.add_tip()
