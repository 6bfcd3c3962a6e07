"""Bodies of a simulated world on the page: where they are drawn, how old they are, their list."""

import numpy as np
import pytest

from app.fixture import MarginState
from app.geometry import SurfaceMesh
from app.runtime import BodyKind, SimulatedWorld, WorldBody
from app.scene.convert import world_matrix, world_points
from app.scene.simulated_bodies import COLOR
from app.viewer import SceneView
from app.viewer.drawing.camera_controller import CameraController, CameraPreset
from app.viewer.drawing.client_scene import ClientScene
from app.viewer.drawing.scene_view import Part
from app.viewer.world_part import WorldPart
from tests.manual_clock import ManualClock

pytestmark = pytest.mark.slow

S = 1_000_000_000
START_NS = 1000 * S
CORNERS = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
TURNED = (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))
"""A quarter about z."""


def body(name, kind=BodyKind.FIXED):
    return WorldBody(name, kind, SurfaceMesh(name, CORNERS, FACES))


class Shown:
    """A page's view with a simulated world, whose frame is that of the tumour's sensor."""

    def __init__(self, parts):
        self.clock = ManualClock(START_NS)
        self.world = SimulatedWorld("world", "tumor_sensor", self.clock)
        self.view = SceneView(parts.content, added=(Part.BODIES,))
        self.view.view.render_window().SetSize(640, 400)
        self.part = WorldPart(self.world)
        self._parts = parts

    def update(self, frame=0):
        self.view.show(self._parts.feed.shown[frame])
        return self.part.update(self._parts.feed.shown[frame], self.view)

    def values(self):
        return self.part.values()["world"]


@pytest.fixture
def shown(can_draw, parts):
    shown = Shown(parts)
    shown.view.show(parts.feed.shown[0])
    shown.world.tracker = next(
        edge.source
        for edge in parts.feed.shown[0].measured
        if edge.source != shown.view.scene.reference
    )
    shown.world.set_bodies([body("wall"), body("tumor", BodyKind.TISSUE)])
    shown.world.set_places(
        {"wall": (10, 20, 30, *TURNED), "tumor": (0, 0, 0, 0, 0, 0, 1)}, START_NS
    )
    shown.update()
    return shown


def test_body_is_where_the_physics_has_it_in_the_frame_of_the_tracker(shown):
    for frame, x in ((0, 10.0), (3, 11.0)):  # the frame of the tracker moves, too
        shown.world.set_places({"wall": (x, 20, 30, *TURNED)}, START_NS)
        shown.update(frame)
        expected = np.array([[0, -1, 0, x], [1, 0, 0, 20], [0, 0, 1, 30], [0, 0, 0, 1]])
        base = world_matrix(shown.view.scene.tree.node(shown.world.tracker))
        found = world_matrix(shown.view.bodies["wall"].GetParentTransformNode())
        np.testing.assert_allclose(found, base @ expected, atol=1e-9)
        assert np.abs(base - np.eye(4)).max() > 1e-3


def test_only_bodies_are_drawn_and_all_are_listed(shown):
    assert set(shown.view.bodies) == {"wall"}
    values = shown.values()
    assert [(row["name"], row["kind"], row["place"], row["body"]) for row in values["rows"]] == [
        ("wall", "fixed body", "10.0, 20.0, 30.0 mm", True),
        ("tumor", "tissue", "0.0, 0.0, 0.0 mm", False),
    ]
    assert values["count"] == "1 body"
    assert values["problem"] == "no simulation receives requests"


def test_old_places_are_grey_and_have_their_age(shown, parts):
    display = shown.view.bodies["wall"].GetDisplayNode()
    assert display.GetColor() == pytest.approx(COLOR)
    assert (shown.values()["light"], shown.values()["age"]) == ("valid", "0 ms")
    shown.clock.ns += parts.content.margins.stale_after_ns + 1
    shown.update()
    assert display.GetColor() == pytest.approx(MarginState.UNKNOWN.color)
    assert shown.values()["light"] == "stale"
    shown.clock.ns = START_NS + 3 * S
    shown.update()
    assert shown.values()["age"] == "3.0 s"


def test_removed_body_leaves_the_scene(shown):
    before = shown.view.application.scene.GetNumberOfNodes()
    shown.world.set_bodies([body("wall"), body("clip", BodyKind.ADDED)])
    shown.world.set_places(dict.fromkeys(("wall", "clip"), (0, 0, 0, 0, 0, 0, 1)), START_NS)
    assert shown.update()
    assert set(shown.view.bodies) == {"wall", "clip"}
    shown.world.set_bodies([body("wall")])
    assert shown.update()
    assert not shown.update()
    assert set(shown.view.bodies) == {"wall"}
    assert shown.view.application.scene.GetNumberOfNodes() == before


def test_bodies_are_a_part_of_the_display_and_the_overview_contains_them(shown):
    assert Part.BODIES in shown.view.parts
    shown.view.set_visible(Part.BODIES, False)
    assert not shown.view.bodies["wall"].GetDisplayNode().GetVisibility()
    camera = CameraController(shown.view)
    camera.select(CameraPreset.OVERVIEW)
    shown.world.set_places({"wall": (400, 0, 0, *TURNED)}, START_NS)
    shown.update()
    camera.update()
    active = shown.view.view.renderer().GetActiveCamera()
    points = world_points(shown.view.bodies["wall"])
    matrix = active.GetCompositeProjectionTransformMatrix(1.6, -1.0, 1.0)
    placed = (
        np.column_stack([points, np.ones(len(points))]) @ np.array(matrix.GetData()).reshape(4, 4).T
    )
    assert (np.abs(placed[:, :2] / placed[:, 3:]) < 1.0).all()


def test_browser_draws_the_bodies_that_the_server_has(shown):
    client = ClientScene(shown.view)
    assert f"{Part.BODIES}/wall" in client.new_surfaces()["surfaces"]
    drawn = {each["name"]: each for each in client.drawn()}
    matrix = world_matrix(shown.view.bodies["wall"].GetParentTransformNode())
    np.testing.assert_allclose(
        drawn[f"{Part.BODIES}/wall"]["actor"]["userMatrix"], matrix.T.ravel(), atol=1e-3
    )


def test_page_without_a_simulated_world_has_no_such_part(can_draw, parts):
    assert Part.BODIES not in SceneView(parts.content).parts
