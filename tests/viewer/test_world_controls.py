"""Edits of a simulated world by the page: commands, the mouse, an uploaded file."""

import asyncio

import numpy as np
import pytest
from aiohttp import web
from aiohttp.test_utils import TestClient, TestServer

from app.files.meshes import write_mesh
from app.geometry import SurfaceMesh
from app.runtime import MAX_BODY_TRIANGLES, BodyKind
from app.viewer.access_control import ROLE
from app.viewer.address import Role
from app.viewer.drawing.camera_controller import CameraController, CameraPreset
from app.viewer.drawing.grips import PicturePoints, first_hit
from app.viewer.messages.checks import Commands, NotDoneError, RefusedError
from app.viewer.pointer_parts import BodyDrag
from app.viewer.world_part import MAX_BYTES, BodyUpload, WorldControls
from tests.runtime.test_simulated_world import clock as clock
from tests.runtime.test_simulated_world import owner as owner
from tests.runtime.test_simulated_world import world as world
from tests.viewer.test_hand_part import event
from tests.viewer.test_world_part import CORNERS, FACES, START_NS, Shown, body

pytestmark = pytest.mark.slow

MESH = SurfaceMesh("mesh", CORNERS, FACES)


class Page:
    """The commands of a page that edits ``world``."""

    def __init__(self, world):
        self.commands, self.changes = Commands(self._changed), 0
        WorldControls(self.commands, world)

    def run(self, name, *args, role=Role.OPERATE):
        self.commands.run(f"world_{name}", args, role)

    def _changed(self):
        self.changes += 1


@pytest.fixture
def page(world):
    return Page(world)


def test_move_shifts_and_turns_about_an_axis_of_the_world(page, owner):
    page.run("move", "stone", 1.0, 2.0, 3.0, "z", 90.0)
    _, pose, _ = owner.requests[0]
    np.testing.assert_allclose(pose.translation_mm, [11, 2, 3])
    np.testing.assert_allclose(pose.rotation @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    assert page.changes == 1


@pytest.mark.parametrize(("shape", "size"), [("box", (20, 10, 4)), ("ball", (20, 20, 20))])
def test_added_obstacle_has_its_size_at_its_place(page, owner, shape, size):
    page.run("add", "clip", shape, list(size), [1.0, 2.0, 3.0])
    _, mesh, pose, _ = owner.requests[0]
    low, high = mesh.bounds_mm
    np.testing.assert_allclose(high - low, size, rtol=3e-3)
    np.testing.assert_allclose(high + low, 0.0, atol=1e-9)
    assert mesh.open_edges() == 0
    assert len(mesh.faces) <= MAX_BODY_TRIANGLES
    assert (pose.target, pose.source) == ("world", "clip")
    np.testing.assert_allclose(pose.translation_mm, [1, 2, 3])


def test_only_an_added_body_is_removed(page, owner):
    page.run("remove", "box")
    with pytest.raises(NotDoneError, match="fixed body; expected an added body"):
        page.run("remove", "wall")
    assert [each[0] for each in owner.requests] == ["remove"]


@pytest.mark.parametrize(
    ("name", "args"),
    [
        ("move", ("wall", 1e5, 0, 0, "x", 0)),
        ("move", ("wall", float("nan"), 0, 0, "x", 0)),
        ("move", ("wall", 0, 0, 0, "w", 0)),
        ("move", ("wall", 0, 0, 0)),
        ("add", ("clip", "cone", [1, 1, 1], [0, 0, 0])),
        ("add", ("clip", "box", [1, 1], [0, 0, 0])),
        ("add", ("clip", "box", [1, 1, 0], [0, 0, 0])),
        ("add", ("clip", "box", "111", [0, 0, 0])),
        ("add", ("clip", "box", [1, 1, 1], [0, 0, float("inf")])),
        ("remove", (3,)),
    ],
)
def test_values_out_of_their_ranges_are_refused(page, owner, name, args):
    with pytest.raises(RefusedError, match="expected"):
        page.run(name, *args)
    assert owner.requests == []


@pytest.mark.parametrize("name", ["", "3d", "a/b", "a b", "x" * 33, "../x"])
def test_name_that_no_body_may_have_is_not_requested(page, owner, name):
    with pytest.raises(NotDoneError, match="expected at most 32 letters"):
        page.run("add", name, "box", [1, 1, 1], [0, 0, 0])
    assert owner.requests == []


def test_viewer_may_edit_nothing(page, owner):
    for name, args in (
        ("move", ("wall", 1.0, 0, 0, "x", 0)),
        ("add", ("clip", "box", [1, 1, 1], [0, 0, 0])),
        ("remove", ("box",)),
    ):
        with pytest.raises(RefusedError, match="role view; expected operate"):
            page.run(name, *args, role=Role.VIEW)
    assert owner.requests == []


class Dragged:
    """A page's view with a body in the middle of the picture, and the pointer on it."""

    def __init__(self, parts, owner):
        self.shown = Shown(parts)
        view = self.shown.view
        view.view.render_window().SetSize(800, 600)
        view.show(parts.feed.shown[0])
        self.world = self.shown.world
        self.world.connect(owner)
        self.world.tracker = view.scene.reference
        self.world.set_bodies([body("wall"), body("clip", BodyKind.ADDED)])
        places = {"wall": (300, 0, 0, 0, 0, 0, 1), "clip": (-300, 0, 0, 0, 0, 0, 1)}
        self.world.set_places(places, START_NS)
        self.shown.update()
        camera = CameraController(view)
        camera.select(CameraPreset.OVERVIEW)
        camera.update()
        self.picture = PicturePoints(view)
        self.drag = BodyDrag(view, self.world)
        self.on_body = self.at(np.array([302.0, 2.0, 2.0]))

    def at(self, point_mm):
        return self.picture.projected(point_mm[None])[0]

    def take(self, kind, at, page="page1", **keys):
        return self.drag.take(page, event(kind, at, **keys))


@pytest.fixture
def dragged(can_draw, parts, owner):
    return Dragged(parts, owner)


def test_dragged_body_follows_the_pointer_in_the_plane_that_faces_the_camera(dragged, owner):
    assert dragged.take("LeftButtonPress", dragged.on_body, shiftKey=1)
    assert owner.requests == []
    end = dragged.on_body + np.array([0.05, -0.1])
    assert dragged.take("MouseMove", end, shiftKey=1)
    assert dragged.take("LeftButtonRelease", end)
    (_, pose, first), (_, last, second) = owner.requests
    np.testing.assert_allclose(last.translation_mm, pose.translation_mm)
    assert second.ns > first.ns
    assert pose.source == "wall"
    way = pose.translation_mm - [300, 0, 0]
    camera = dragged.shown.view.view.renderer().GetActiveCamera()
    assert np.linalg.norm(way) > 10.0
    assert abs(way @ np.array(camera.GetDirectionOfProjection())) < 1e-6
    assert not dragged.take("MouseMove", dragged.on_body, shiftKey=1)


def test_press_without_shift_or_beside_the_bodies_is_for_others(dragged, owner):
    assert not dragged.take("LeftButtonPress", dragged.on_body)
    assert not dragged.take("LeftButtonPress", dragged.on_body, shiftKey=1, ctrlKey=1)
    assert not dragged.take("LeftButtonPress", np.array([0.02, 0.02]), shiftKey=1)
    assert not dragged.take("MouseMove", dragged.on_body, shiftKey=1)
    assert owner.requests == []


def test_one_page_drags_at_a_time_until_it_lets_go(dragged, owner):
    assert dragged.take("LeftButtonPress", dragged.on_body, shiftKey=1)
    assert not dragged.take("LeftButtonPress", dragged.on_body, page="page2", shiftKey=1)
    dragged.drag.gone("page2")
    assert dragged.take("MouseMove", dragged.on_body)
    dragged.drag.gone("page1")
    assert dragged.take("LeftButtonPress", dragged.on_body, page="page2", shiftKey=1)
    assert dragged.take("RightButtonPress", dragged.on_body, page="page2")  # ends it
    assert not dragged.take("MouseMove", dragged.on_body, page="page2")
    assert len(owner.requests) == 1


def test_drag_ends_without_a_simulation(dragged, owner):
    assert dragged.take("LeftButtonPress", dragged.on_body, shiftKey=1)
    owner.connected = False
    assert dragged.take("MouseMove", dragged.on_body)
    assert not dragged.take("MouseMove", dragged.on_body)
    assert owner.requests == []


def test_first_hit_is_the_nearest_triangle():
    near = np.array([[-1.0, -1.0, 5.0], [3.0, -1.0, 5.0], [-1.0, 3.0, 5.0]])
    far = near - [0.0, 0.0, 4.0]
    start, end = np.array([0.0, 0.0, 10.0]), np.array([0.0, 0.0, 0.0])
    assert first_hit(start, end, np.stack([far, near])) == pytest.approx(0.5)
    assert first_hit(start, end, far[None, ::-1]) == pytest.approx(0.9)
    beside = np.array([5.0, 5.0, 0.0])
    assert first_hit(start + beside, end + beside, near[None]) is None
    assert first_hit(start, start + beside, near[None]) is None


def upload(world, path, content, role=Role.OPERATE):
    """Status and problem of a POST."""

    async def send():
        @web.middleware
        async def with_role(request, handler):
            request[ROLE] = role
            return await handler(request)

        app = web.Application(middlewares=[with_role])
        app.router.add_post("/body/{name}", BodyUpload(world).post)
        async with TestClient(TestServer(app)) as client:
            answer = await client.post(path, data=content)
            text = await answer.text() if answer.status != 403 else "{}"
            return answer.status, text

    return asyncio.run(send())


def stl(tmp_path, mesh):
    write_mesh(tmp_path / "mesh.stl", mesh)
    return (tmp_path / "mesh.stl").read_bytes()


PLACE = "?x=1&y=2&z=3.5"


def test_uploaded_surface_becomes_a_body_at_its_place(world, owner, tmp_path):
    assert upload(world, f"/body/clip{PLACE}", stl(tmp_path, MESH)) == (200, "{}")
    _, mesh, pose, _ = owner.requests[0]
    np.testing.assert_allclose(mesh.bounds_mm, MESH.bounds_mm)
    assert len(mesh.faces) == len(FACES)
    np.testing.assert_allclose(pose.translation_mm, [1, 2, 3.5])


def many_triangles():
    points = np.random.default_rng(1).normal(size=(3 * (MAX_BODY_TRIANGLES + 1), 3))
    return SurfaceMesh("many", points, np.arange(len(points)).reshape(-1, 3))


def test_file_that_cannot_be_a_body_is_refused_with_the_reason(world, owner, tmp_path):
    whole = stl(tmp_path, MESH)
    for path, content, reason in (
        (f"/body/clip{PLACE}", b"solid of nothing", "clip.stl"),
        (f"/body/clip{PLACE}", b"", "clip.stl"),
        (f"/body/clip{PLACE}", whole[:-7], "clip.stl"),
        (f"/body/clip{PLACE}", stl(tmp_path, many_triangles()), "5001 triangles"),
        (f"/body/clip{PLACE}", bytes(MAX_BYTES + 1), "larger than 4 MiB"),
        (f"/body/3d{PLACE}", whole, "at most 32 letters"),
        ("/body/clip?x=1&y=2", whole, "expected x, y and z"),
        ("/body/clip?x=1&y=2&z=nan", whole, "expected x, y and z"),
        ("/body/clip?x=1&y=2&z=1e5", whole, "expected x, y and z"),
    ):
        status, text = upload(world, path, content)
        assert (status, reason in text) == (409, True), (path, text)
        assert str(tmp_path.parent) not in text
    owner.connected = False
    assert "no simulation receives" in upload(world, f"/body/clip{PLACE}", whole)[1]
    assert owner.requests == []


def test_viewer_uploads_nothing(world, owner, tmp_path):
    status, _ = upload(world, f"/body/clip{PLACE}", stl(tmp_path, MESH), Role.VIEW)
    assert status == 403
    assert owner.requests == []
