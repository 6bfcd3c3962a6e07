"""The page of a live session after a change of tumour, margins or registration."""

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from app.geometry import MeshError, SurfaceMesh
from app.hold import SeenHold
from app.registration import register_points
from app.runtime import SessionContent
from app.viewer import LiveSteps
from tests.session_content import one_link_content, registered


def ball(radius_mm):
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=radius_mm)
    return SurfaceMesh("tumor", mesh.vertices, mesh.faces)


class Feed:
    """Test double of a feed: what was put into it last."""

    def __init__(self):
        self.content: SessionContent | None = None
        self.margin_surface: SurfaceMesh | None = None
        self.seen: SeenHold | None = None

        self.request = None

    def put(self, step, content, margin_surface, seen, delay_ns):
        self.content, self.margin_surface, self.seen = content, margin_surface, seen

    def list_of_session(self, request):
        self.request = request


class Operator:
    """Test double of a session's operator."""

    last_request = "the last request"

    def __init__(self, content):
        self.content = content

    def seen(self):
        return SeenHold(7, 99)


@pytest.fixture
def feed():
    return Feed()


@pytest.fixture
def content():
    return replace(one_link_content(), tumor=ball(10.0))


@pytest.fixture
def workers():
    with ThreadPoolExecutor(max_workers=1) as workers:
        yield workers


class FailingWorkers:
    """Test double of a pool whose work fails."""

    def submit(self, *work):
        made: Future = Future()
        made.set_exception(MeshError("the margin surface is not closed"))
        return made


def test_without_a_change_content_and_surface_stay_the_same_objects(feed, content, workers):
    surface = ball(11.0)
    LiveSteps(feed, content, surface, workers).put("step", Operator(content))
    assert feed.content is content
    assert feed.margin_surface is surface


def test_another_tumour_has_its_own_margin_surface_and_never_the_one_before(feed, content, workers):
    before = ball(11.0)
    steps = LiveSteps(feed, content, before, workers)
    other = replace(content, tumor=ball(5.0))
    steps.put("step", Operator(other))
    assert feed.content is other
    assert feed.margin_surface is not before
    workers.shutdown()
    steps.put("step", Operator(other))
    assert feed.content is other
    assert feed.margin_surface is not None
    assert abs(feed.margin_surface.vertices_mm).max() == pytest.approx(6.0, abs=0.1)


def test_another_registration_is_in_the_content_of_the_next_step(feed, content, workers):
    steps = LiveSteps(feed, content, None, workers)
    corners = 50.0 * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    off = corners + np.diag([0.1, 0.2, 0.1, 0.0])[:, :3]
    found = register_points(corners, off, fixed_frame="reference", moving_frame="robot_base")
    other = registered(content, found)
    steps.put("step", Operator(other))
    assert feed.content.registration is found
    assert found.transform in feed.content.static_edges


def test_session_continues_without_margin_surface(feed, content, capsys):
    steps = LiveSteps(feed, content, ball(11.0), FailingWorkers())
    other = replace(content, tumor=ball(5.0))
    steps.put("step", Operator(other))
    assert feed.margin_surface is None
    assert feed.content is other
    error = capsys.readouterr().err
    assert error == "no margin surface is shown: the margin surface is not closed\n"


def test_each_step_is_shown_with_the_hold_and_the_request_that_came_with_it(feed, content, workers):
    LiveSteps(feed, content, None, workers).put("step", Operator(content))
    assert feed.seen == SeenHold(7, 99)
    assert feed.request == "the last request"
