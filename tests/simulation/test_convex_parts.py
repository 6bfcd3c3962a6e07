"""Convex parts are cached by content, and a damaged file is computed again."""

import logging

import numpy as np
import pytest
import trimesh

from app.cli import caches
from app.fixture.proximity.field_cache import cache_folder
from app.geometry import SurfaceMesh
from app.simulation import WorldError
from app.simulation.convex_parts import PARTS_FOLDER
from app.simulation.convex_parts import convex_parts as parts_of


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return cache_folder() / PARTS_FOLDER


def angle() -> SurfaceMesh:
    """Two arms of 40 mm, 10 mm thick, in the shape of an L."""
    outline = np.array([[0, 0], [40, 0], [40, 10], [10, 10], [10, 40], [0, 40]], dtype=float)
    bottom = np.column_stack([outline, np.zeros(6)])
    top = bottom + np.array([0.0, 0.0, 10.0])
    cap = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]
    faces = [[a, c, b] for a, b, c in cap] + [[a + 6, b + 6, c + 6] for a, b, c in cap]
    for i in range(6):
        j = (i + 1) % 6
        faces += [[i, j, j + 6], [i, j + 6, i + 6]]
    return SurfaceMesh("angle", np.concatenate([bottom, top]), faces).require_closed("angle")


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
        "app.simulation.convex_parts._decompose", lambda mesh, what: pytest.fail("computed")
    )
    second = parts_of(angle(), "parts", "angle")
    assert [each.tobytes() for each in first] == [each.tobytes() for each in second]
    kinds = {each.kind: caches.inspect(each).count for each in caches.cache_folders()}
    assert kinds[caches.PARTS] == 1


@pytest.mark.parametrize("damage", [b"", b"marginguard parts 1\n", b"x" * 500])
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
    corners = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [9, 9, 0]])
    flat = SurfaceMesh("flat", corners, [[0, 1, 2], [1, 3, 2]])
    with pytest.raises(WorldError, match=r"^plate: its surface encloses no volume; expected a"):
        parts_of(flat, "hull", "plate")
