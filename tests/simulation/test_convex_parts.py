"""Convex parts are cached by content, and a damaged file is computed again."""

import logging

import numpy as np
import pytest
import shapely
import trimesh

from app.cli import caches
from app.fixture.proximity.field_cache import cache_folder
from app.geometry import SurfaceMesh
from app.simulation import WorldError
from app.simulation.rigid_body import PARTS_FOLDER
from app.simulation.rigid_body import convex_parts as parts_of
from tests.simulation.conftest import flat_sheet

pytestmark = pytest.mark.slow


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return cache_folder() / PARTS_FOLDER


def angle() -> SurfaceMesh:
    """Two arms of 40 mm, 10 mm thick, in the shape of an L."""
    outline = shapely.Polygon([(0, 0), (40, 0), (40, 10), (10, 10), (10, 40), (0, 40)])
    shape = trimesh.creation.extrude_polygon(outline, 10.0)
    return SurfaceMesh("angle", shape.vertices, shape.faces).require_closed("angle")


def volume_of(corners: list[np.ndarray]) -> float:
    return sum(float(trimesh.convex.convex_hull(each).volume) for each in corners)


def test_parts_fill_the_surface_and_a_hull_fills_more(folder):
    mesh = angle()
    parts = parts_of(mesh, "parts", "angle")
    assert len(parts) == 2
    assert volume_of(parts) == pytest.approx(mesh.signed_volume_mm3, rel=0.01)
    assert volume_of(parts_of(mesh, "hull", "angle")) > 1.3 * mesh.signed_volume_mm3
    assert parts_of(mesh, "none", "angle") == []


def test_second_call_reads_the_file(folder, monkeypatch):
    first = parts_of(angle(), "parts", "angle")
    (file,) = folder.iterdir()
    assert file.suffix == ".parts" and folder.stat().st_mode & 0o077 == 0
    monkeypatch.setattr(
        "app.simulation.rigid_body._decompose", lambda mesh, what: pytest.fail("computed")
    )
    second = parts_of(angle(), "parts", "angle")
    assert [each.tobytes() for each in first] == [each.tobytes() for each in second]
    kinds = {each.kind: caches.visit(each, removing=False).count for each in caches.cache_folders()}
    assert kinds[caches.PARTS] == 1


@pytest.mark.parametrize("damage", [b"marginguard parts 1\n", b"x" * 500])
def test_damaged_file_is_computed_again(folder, damage, caplog):
    first = parts_of(angle(), "parts", "angle")
    (file,) = folder.iterdir()
    content = file.read_bytes()
    file.write_bytes(damage)
    with caplog.at_level(logging.WARNING):
        second = parts_of(angle(), "parts", "angle")
    assert "is damaged or of another version" in caplog.text
    assert [each.tobytes() for each in first] == [each.tobytes() for each in second]
    assert file.read_bytes() == content


def test_folder_that_cannot_be_written_costs_time_only(folder, monkeypatch, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    assert len(parts_of(angle(), "parts", "angle")) == 2


def test_flat_surface_is_refused(folder):
    with pytest.raises(WorldError, match=r"^plate: its surface encloses no volume; expected a"):
        parts_of(flat_sheet(), "hull", "plate")
