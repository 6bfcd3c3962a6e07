"""The content of a live session that is given another tumour or margin."""

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from app.bridge import ReplayScene
from app.cli.live_page import LiveContent
from app.geometry import MeshError, SurfaceMesh, Transform
from app.registration import DriftBound, given_registration, register_points
from app.robot import Link, Robot
from app.runtime import SessionContent
from app.session import RobotSetup
from tests.doubles import PARAMETERS


def ball(radius_mm: float) -> SurfaceMesh:
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=radius_mm)
    return SurfaceMesh("tumor", mesh.vertices, mesh.faces)


@pytest.fixture
def scene() -> ReplayScene:
    return ReplayScene(static_edges=(), tumor=ball(10.0), tool=None, margins=PARAMETERS)


@pytest.fixture
def content(scene: ReplayScene) -> SessionContent:
    return SessionContent(
        name="case",
        tumor=scene.tumor,
        tool=None,
        tip_frame="tip",
        static_edges=(),
        margins=PARAMETERS,
        robot=RobotSetup(
            Robot("block", (Link("base", ()),), ()),
            "robot_base",
            "base",
            registration=None,
            max_drift=DriftBound(translation_mm=1.0, rotation_rad=0.1),
        ),
    )


@pytest.fixture
def makers() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(max_workers=1) as makers:
        yield makers


class NoMaker:
    """Test double of a pool whose work fails."""

    def submit(self, *work: object) -> Future:
        made: Future = Future()
        made.set_exception(MeshError("the margin surface is not closed"))
        return made


def test_without_a_change_the_content_stays_one_object(content, scene, makers):
    surface = ball(11.0)
    contents = LiveContent(content, surface, scene, makers)
    assert contents.of(scene) == (content, surface)


def test_another_tumour_has_the_margin_surface_that_is_made_of_it(content, scene, makers):
    contents = LiveContent(content, ball(11.0), scene, makers)
    other = replace(scene, tumor=ball(5.0))
    assert contents.of(other)[0].tumor is other.tumor
    makers.shutdown()
    shown, made = contents.of(other)
    assert shown is contents.of(other)[0]
    assert made is not None
    assert abs(made.vertices_mm).max() == pytest.approx(6.0, abs=0.1)


def test_another_registration_is_in_the_content_of_the_next_step(content, scene, makers):
    given = given_registration(Transform.identity("reference", "robot_base"))
    contents = LiveContent(content, None, replace(scene, registration=given), makers)
    corners = 50.0 * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    off = corners + np.diag([0.1, 0.2, 0.1, 0.0])[:, :3]
    found = register_points(corners, off, fixed_frame="reference", moving_frame="robot_base")
    edges = (found.transform, Transform.identity("robot_base", "base"))
    shown, _ = contents.of(replace(scene, registration=found, static_edges=edges))
    assert shown.registration is found
    assert shown.static_edges == (found.transform,)
    assert contents.of(replace(scene, registration=given))[0].registration is given


def test_the_session_goes_on_where_no_margin_surface_can_be_made(content, scene, capsys):
    contents = LiveContent(content, ball(11.0), scene, NoMaker())
    other = replace(scene, tumor=ball(5.0))
    shown, margin_surface = contents.of(other)
    assert margin_surface is None
    assert shown.tumor is other.tumor
    assert contents.of(other)[1] is None
    assert (
        capsys.readouterr().err == "no margin surface is shown: the margin surface is not closed\n"
    )
