"""The contour of a live session: from points at the tip to the session's tumour."""

import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from app.fixture import MarginState
from app.geometry import Stamp, TrackedTransform, TrackingStatus, Transform
from app.runtime import ShownItem, compute_here
from app.session import KnownEdges
from app.viewer.address import Role
from app.viewer.contour_part import ContourControls, ContourPart
from app.viewer.messages.checks import Commands, NotDoneError
from tests.runtime.test_operator_commands import CONTENT, TUMOR_EDGE, World
from tests.viewer.guided_part import connect, must_not_be_used, requested
from tests.viewer.guided_part import operator as operator

pytestmark = pytest.mark.slow

WITHOUT_SCENE = SimpleNamespace(scene=None)
"""Test double of a scene view before tool and tumour are known."""
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
CORNERS = np.array([[12, 0, 0], [-12, 0, 0], [0, 12, 0], [0, -12, 0], [0, 0, 12], [0, 0, -12]])


class Contouring:
    """A contour part with its commands, and the waiting for its surface."""

    def __init__(self, request=must_not_be_used, compute=compute_here):
        self.computed = threading.Semaphore(0)
        operator = SimpleNamespace(request=request, compute=compute)
        self.part = ContourPart(CONTENT, self.computed.release, operator)
        self.commands = Commands()
        ContourControls(self.commands, self.part, live=True)

    def run(self, name, *args):
        self.commands.run(name, ["me", *args], Role.OPERATE)

    @property
    def revision(self):
        return self.part.editor.revision

    def add(self, places):
        # As the clicks on an image whose pixels are in mm, at different heights.
        for number, (x, y, z) in enumerate(places):
            matrix = np.eye(4)
            matrix[2, 3] = z
            self.part.places.show(None, number, matrix)
            self.run("contour_add", number, float(x), float(y))

    def finish(self):
        """Wait until the surface of the present points is computed."""
        for _ in range(3):
            self.part.update(None, WITHOUT_SCENE)
            if self.part.values()["contour"]["computed"]:
                return
            assert self.computed.acquire(timeout=60.0)
        raise AssertionError("not computed")


@pytest.fixture
def world():
    return World()


def test_contour_becomes_the_tumour_in_its_frame_with_its_uncertainty(world, operator):
    contouring = Contouring(operator.request)
    contouring.add(CORNERS)
    contouring.run("contour_calibration", contouring.revision, 0.5)
    contouring.finish()
    with pytest.raises(NotDoneError, match="the session is not ready"):
        contouring.run("contour_accept", contouring.revision)
    connect(operator, world)
    contouring.run("contour_accept", contouring.revision)
    request = requested(world)
    tumor = world.commands.content.tumor
    assert (tumor.frame, TUMOR_EDGE.source) == ("tumor", "tumor")
    low, high = tumor.transformed(TUMOR_EDGE).bounds_mm
    np.testing.assert_allclose([low, high], [[-12] * 3, [12] * 3], atol=0.1)
    sigma_mm = world.session.setup.tumor_sigma_mm
    assert sigma_mm == pytest.approx(
        float(contouring.part.values()["contour"]["sigma_mm"]), abs=0.005
    )
    assert sigma_mm > 0.5
    assert "tumour replaced" in world.session.hold_causes[0]
    assert (request.accepted, request.origin) == (True, "the page")


def test_marked_hydromark_becomes_the_tumour_with_the_uncertainty_of_its_place(world, operator):
    connect(operator, world)
    contouring = Contouring(operator.request)
    contouring.add(CORNERS[:1])
    for name, value in (("hydromark", 2.0), ("dilation", 1.0), ("calibration", 0.5)):
        contouring.run(f"contour_{name}", contouring.revision, value)
    contouring.finish()
    contouring.run("contour_accept", contouring.revision)
    requested(world)
    tumor = world.commands.content.tumor.transformed(TUMOR_EDGE)
    np.testing.assert_allclose(tumor.centroid_mm, CORNERS[0], atol=0.02)
    assert tumor.signed_volume_mm3 == pytest.approx(36.0 * np.pi, rel=0.01)
    assert world.session.setup.tumor_sigma_mm == pytest.approx(np.hypot(0.5, 12.0**-0.5))
    assert "tumour replaced" in world.session.hold_causes[0]


def test_contour_that_is_not_ready_is_refused_in_one_line():
    contouring = Contouring()
    with pytest.raises(NotDoneError, match="no points; expected 4 or more"):
        contouring.run("contour_accept", 0)
    contouring.add(CORNERS[:2])
    with pytest.raises(NotDoneError, match="its surface is being computed"):
        contouring.run("contour_accept", contouring.revision)
    contouring.finish()
    with pytest.raises(NotDoneError, match="2 points; expected 4 or more"):
        contouring.run("contour_accept", contouring.revision)
    contouring.add(CORNERS)
    contouring.finish()
    with pytest.raises(NotDoneError, match="the error of its points is not stated"):
        contouring.run("contour_accept", contouring.revision)
    with pytest.raises(NotDoneError, match="another page has changed it meanwhile"):
        contouring.commands.run("contour_accept", ["other", 0], Role.OPERATE)


def test_clicks_on_unknown_images_and_unknown_tips_are_refused():
    contouring = Contouring()
    with pytest.raises(NotDoneError, match="the place of image 7 is not known"):
        contouring.run("contour_add", 7, 1.0, 1.0)
    with pytest.raises(NotDoneError, match="the tip's place is UNKNOWN"):
        contouring.run("contour_tip", "cautery")
    assert contouring.revision == 0


def test_point_at_the_tip_of_the_stylus_is_that_of_the_tracker():
    tip = Transform("stylus", "stylus_tip", np.eye(3), [3.0, -4.0, 150.0])
    stylus = Transform("needle", "stylus", TURN, [10.0, 20.0, 30.0])
    tracked = TrackedTransform(stylus, Stamp(1), TrackingStatus.OK)
    step = SimpleNamespace(
        edges=KnownEdges(measured={("needle", "stylus"): tracked}),
        decision=SimpleNamespace(reasons=(), state=MarginState.UNKNOWN),
        tumor_from_tip=None,
    )
    content = replace(CONTENT, items=(ShownItem("stylus", "stylus").with_tip(tip, 0.2),))
    contouring = Contouring()
    shown = SimpleNamespace(step=step, content=content, silent="")
    contouring.part.places.show(shown, None, None)
    contouring.run("contour_tip", "stylus")
    point = contouring.part.editor.contour.points[0]
    np.testing.assert_allclose(point.position_mm, [14.0, 23.0, 180.0], atol=1e-9)
    with pytest.raises(NotDoneError, match=r"^cautery: the tip's place is UNKNOWN"):
        contouring.run("contour_tip", "cautery")
    for state, problem in (
        ({"silent": "the session has ended"}, "stylus: the tip's place is UNKNOWN"),
        (
            {"content": replace(CONTENT, items=(ShownItem("stylus", "stylus"),))},
            "stylus: it is not calibrated; expected a pivot calibration before",
        ),
        ({"content": CONTENT}, "stylus: the session has none; expected 'stylus' in live.yaml"),
    ):
        contouring.part.places.show(SimpleNamespace(**{**vars(shown), **state}), None, None)
        with pytest.raises(NotDoneError, match=f"^{problem}"):
            contouring.run("contour_tip", "stylus")
    assert len(contouring.part.editor.contour.points) == 1


def test_surface_that_fails_does_not_end_the_page(caplog):
    def fail(*_):
        raise np.linalg.LinAlgError("singular")

    contouring = Contouring(compute=fail)
    contouring.add(CORNERS)
    contouring.finish()
    with pytest.raises(NotDoneError, match="no surface was found; expected other points"):
        contouring.run("contour_accept", contouring.revision)
    assert "contour of 6 points" in caplog.text
