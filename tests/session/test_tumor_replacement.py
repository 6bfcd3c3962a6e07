"""Replacing the tumour: prepared in one call, its change, and the engines of its tools."""

import math
from functools import cache

import numpy as np
import pytest
import trimesh

from app.fixture import ProximityEngine, prepared_tumor
from app.geometry import FrameError, MeshError, SurfaceMesh, Transform
from app.session import ToolEngines, prepare_replacement, tumor_change
from benchmarks.fixture_shapes import cautery, lobed_tumor
from tests.fixture_shapes import tumor
from tests.forking import run_forked

pytestmark = pytest.mark.slow

FRAME_FROM_TUMOR = Transform.from_rotation_vector(
    [0.4, -1.2, 0.7], [31.0, -4.0, 12.0], target="needle", source="tumor"
)


LOADED = """
import gc
from numba.core.dispatcher import Dispatcher
from app.geometry import Transform
from app.session import load_replacement, prepare_replacement
from benchmarks.fixture_shapes import lobed_tumor

def loaded():
    found = [each for each in gc.get_objects() if isinstance(each, Dispatcher)]
    return {str(each): len(each.overloads) for each in found}

load_replacement()
before = loaded()
prepare_replacement(lobed_tumor(81920), lobed_tumor(20480), Transform.identity("tumor", "tumor"))
assert sum(before.values()) > 20 and loaded() == before, (before, loaded())
assert [n for name, n in before.items() if "_fill_between" in name] == [1]
"""


@pytest.fixture(autouse=True)
def no_shared_field(monkeypatch):
    """Each preparation builds its own field, a small one: tests compare them."""
    monkeypatch.setenv("MARGINGUARD_FIELD_CACHE", "off")
    monkeypatch.setattr("app.fixture.proximity.distance_field.MIN_NODES", 20_000)


@cache
def known() -> SurfaceMesh:
    """The former tumour, in the frame that it moves with."""
    return tumor("spiky", 3).transformed(FRAME_FROM_TUMOR)


@pytest.fixture(scope="module")
def engine() -> ProximityEngine:
    return ProximityEngine(lobed_tumor(80), cautery(500))


@pytest.mark.parametrize("scale", [0.4, 2.5])
def test_replacement_is_that_of_two_calls(engine, scale):
    shape = lobed_tumor(1280)
    new = SurfaceMesh("tumor", scale * shape.vertices_mm + np.array([3.0, 1.0, 0.0]), shape.faces)
    made = prepare_replacement(known(), new, FRAME_FROM_TUMOR)
    expected = tumor_change(known(), new.transformed(FRAME_FROM_TUMOR))
    assert made.change.text == expected.text
    assert 0.0 < made.change.overlap <= 1.0
    one, other = (engine.with_tumor(each) for each in (made.prepared, prepared_tumor(new)))
    pose = Transform("tumor", one.frames[1], np.eye(3), [1.0, 2.0, 20.0 * scale])
    rows = [each.evaluate(pose).witnesses.rows for each in (one, other)]
    np.testing.assert_array_equal(*rows)


def test_a_surface_that_bounds_no_solid_is_refused():
    whole = lobed_tumor(320)
    with pytest.raises(MeshError, match="the tumour's mesh is not closed"):
        prepare_replacement(
            known(), SurfaceMesh("tumor", whole.vertices_mm, whole.faces[1:]), FRAME_FROM_TUMOR
        )


def test_a_surface_in_another_frame_is_refused():
    with pytest.raises(FrameError):
        prepare_replacement(known(), known(), FRAME_FROM_TUMOR)


def test_preparation_finds_its_compiled_functions_loaded():
    done = run_forked("-c", LOADED)
    assert done.returncode == 0, done.stderr


def ball(radius_mm, x_mm=0.0, frame="needle", subdivisions=4):
    mesh = trimesh.creation.icosphere(subdivisions, radius=radius_mm)
    return SurfaceMesh(frame, mesh.vertices + np.array([x_mm, 0.0, 0.0]), mesh.faces)


@pytest.mark.parametrize("shift_mm", [0.0, 5.0, 10.0, 18.0])
def test_overlap_of_two_balls_is_that_of_their_lens(shift_mm):
    change = tumor_change(ball(10.0), ball(10.0, shift_mm))
    share = shift_mm / 20.0
    assert change.overlap == pytest.approx(1.0 - 1.5 * share + 0.5 * share**3, abs=0.02)
    assert change.shift_mm == pytest.approx(shift_mm, abs=1e-6)
    assert change.warnings == ()


def test_ball_of_1_mm_in_the_former_tumour_is_named_for_its_volume():
    change = tumor_change(ball(10.0), ball(0.6, 2.0))
    assert change.overlap == 1.0
    assert change.volumes_mm3[0] == pytest.approx(4.0 / 3.0 * math.pi * 1000.0, rel=0.01)
    assert change.volume_factor == pytest.approx((10.0 / 0.6) ** 3, rel=1e-6)
    np.testing.assert_allclose(change.sizes_mm[1], 1.2, atol=1e-6)
    assert change.text.startswith("tumour replaced: THE VOLUME DIFFERS BY MORE THAN A FACTOR OF 2;")
    assert "bounding box from 20.0 x 20.0 x 20.0 to 1.2 x 1.2 x 1.2 mm" in change.text


@pytest.mark.parametrize("x_mm", [20.5, 30.0, 211.0])
def test_tumour_elsewhere_is_named_for_its_overlap(x_mm):
    change = tumor_change(ball(10.0), ball(10.0, x_mm))
    assert change.overlap == 0.0
    assert change.warnings == ("IT DOES NOT OVERLAP THE FORMER TUMOUR",)


def test_tumours_in_different_frames_are_refused():
    with pytest.raises(FrameError, match="expected one frame"):
        tumor_change(ball(1.0), ball(1.0, frame="reference"))


def test_engines_for_one_tool_are_as_new_ones_and_prepare_it_once(monkeypatch):
    monkeypatch.delenv("MARGINGUARD_FIELD_CACHE")
    shapes = trimesh.creation.box([4, 4, 30]), trimesh.creation.cylinder(2.0, 30.0)
    box, rod = (SurfaceMesh("tool", each.vertices, each.faces) for each in shapes)
    balls = [ball(radius, frame="tumor", subdivisions=2) for radius in (9.0, 12.0)]
    engines, tools = ToolEngines(), []
    for pair in ((balls[0], box), (balls[1], box), (balls[0], rod), (balls[1], box)):
        made, new = engines(*pair), ProximityEngine(*pair)
        tools.append(made._tool.fixed)
        for z_mm in (40.0, 26.0, 25.5, 60.0, 20.0):
            pose = Transform("tumor", "tool", np.eye(3), np.array([1.0, 2.0, z_mm]))
            found, expected = made.evaluate(pose), new.evaluate(pose)
            assert found.lower_bound_mm == expected.lower_bound_mm
            assert found.signed_distance_mm == expected.signed_distance_mm
            assert found.contact == expected.contact
    assert tools[1] is tools[0] and tools[2] is not tools[1] and tools[3] is not tools[2]
