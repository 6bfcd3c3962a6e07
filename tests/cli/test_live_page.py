"""Who stands on the stage of a live session that is given another tumour or margin."""

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from app.bridge import ReplayScene
from app.cli.live_page import Casting
from app.geometry import MeshError, SurfaceMesh, Transform
from app.registration import given_registration, register_points
from app.viewer import Cast
from tests.doubles import PARAMETERS


def ball(radius_mm: float) -> SurfaceMesh:
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=radius_mm)
    return SurfaceMesh("tumor", mesh.vertices, mesh.faces)


@pytest.fixture
def scene() -> ReplayScene:
    return ReplayScene(static_edges=(), tumor=ball(10.0), tool=None, margins=PARAMETERS)


@pytest.fixture
def cast(scene: ReplayScene) -> Cast:
    return Cast(tumor=scene.tumor, margin=ball(11.0), tool=None, tip_frame="tip", fixed=())


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


def test_without_a_change_the_cast_stays_one_object(cast, scene, makers):
    casting = Casting(cast, scene, makers)
    assert casting.of(scene) is cast


def test_another_tumour_has_the_margin_surface_that_is_made_of_it(cast, scene, makers):
    casting = Casting(cast, scene, makers)
    other = replace(scene, tumor=ball(5.0))
    assert casting.of(other).tumor is other.tumor
    makers.shutdown()
    made = casting.of(other).margin
    assert made is not None
    assert abs(made.vertices_mm).max() == pytest.approx(6.0, abs=0.1)


def test_a_registration_that_is_found_anew_says_how_well_it_went(cast, scene, makers):
    given = given_registration(Transform.identity("reference", "robot_base"))
    casting = Casting(replace(cast, registration=given), replace(scene, registration=given), makers)
    corners = 50.0 * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    off = corners + np.diag([0.1, 0.2, 0.1, 0.0])[:, :3]
    found = register_points(corners, off, fixed_frame="reference", moving_frame="robot_base")
    shown = casting.of(replace(scene, registration=found, static_edges=(found.transform,)))
    assert shown.registration is found
    assert shown.fixed == (found.transform,)
    assert casting.of(replace(scene, registration=given)).registration is given


def test_the_session_goes_on_where_no_margin_surface_can_be_made(cast, scene, capsys):
    casting = Casting(cast, scene, NoMaker())
    other = replace(scene, tumor=ball(5.0))
    assert casting.of(other).margin is None
    assert casting.of(other).tumor is other.tumor
    assert (
        capsys.readouterr().err == "no margin surface is shown: the margin surface is not closed\n"
    )
