"""A replacement prepared in one call is that of the separate calls, also in another frame."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from app.fixture import ProximityEngine, prepared_tumor
from app.geometry import FrameError, MeshError, SurfaceMesh, Transform
from app.session import prepare_replacement, tumor_change
from benchmarks.fixture_shapes import cautery, lobed_tumor, tumor

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


def known() -> SurfaceMesh:
    """The former tumour, in the frame that it moves with."""
    return tumor("spiky", 3).transformed(FRAME_FROM_TUMOR)


@pytest.mark.parametrize("scale", [0.4, 1.0, 2.5])
def test_replacement_is_that_of_two_calls(scale: float) -> None:
    shape = lobed_tumor(1280)
    new = SurfaceMesh("tumor", scale * shape.vertices_mm + np.array([3.0, 1.0, 0.0]), shape.faces)
    made = prepare_replacement(known(), new, FRAME_FROM_TUMOR)
    expected = tumor_change(known(), new.transformed(FRAME_FROM_TUMOR))
    assert made.change.text == expected.text
    assert 0.0 < made.change.overlap <= 1.0
    engine = ProximityEngine(lobed_tumor(80), cautery(500))
    one, other = (engine.with_tumor(each) for each in (made.prepared, prepared_tumor(new)))
    pose = Transform("tumor", one.frames[1], np.eye(3), [1.0, 2.0, 20.0 * scale])
    rows = [each.evaluate(pose).witnesses.rows for each in (one, other)]
    np.testing.assert_array_equal(*rows)


def test_a_surface_that_bounds_no_solid_is_refused() -> None:
    whole = lobed_tumor(320)
    with pytest.raises(MeshError, match="the tumour's mesh is not closed"):
        prepare_replacement(
            known(), SurfaceMesh("tumor", whole.vertices_mm, whole.faces[1:]), FRAME_FROM_TUMOR
        )


def test_a_surface_in_another_frame_is_refused() -> None:
    with pytest.raises(FrameError):
        prepare_replacement(known(), known(), FRAME_FROM_TUMOR)


def test_preparation_finds_its_compiled_functions_loaded(project_root: Path) -> None:
    subprocess.run([sys.executable, "-c", LOADED], cwd=project_root, check=True)
