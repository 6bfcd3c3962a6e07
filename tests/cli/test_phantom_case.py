"""The recorded case in ``data/phantom_case``, compared with independent arithmetic.

The oracle reads the text of the recording by regular expressions and measures the distance of the
sphere's centre to the triangles of the stylus by libigl.
"""

import runpy

import igl
import numpy as np
import pytest
import trimesh
import yaml

import marginguard as mg
from app.analysis import find_breaches
from app.report import ReportRow
from tests.oracles.igsio_text import igsio_samples, igsio_times_s

pytestmark = pytest.mark.slow

RADIUS_MM = 10.0
OUT_OF_REACH = 2
"""Frames in which the arm cannot follow the hand."""


@pytest.fixture(scope="module")
def folder(project_root):
    return project_root / "data" / "phantom_case"


@pytest.fixture(scope="module")
def manifest(folder):
    return yaml.safe_load((folder / "case.yaml").read_text())


@pytest.fixture(scope="module")
def steps(folder):
    return list(mg.replay(mg.open_case(folder)))


@pytest.fixture(scope="module")
def tips(folder, manifest):
    """``reference_from_tip`` (n, 4, 4)."""
    recording = folder / "tracking.igs.mha"
    reference, stylus = (
        igsio_samples(recording, f"{name}ToTracker").matrices for name in ("Reference", "Stylus")
    )
    tip = np.reshape(manifest["tool"]["tip_from"]["matrix"], (4, 4))
    return np.linalg.inv(reference) @ stylus @ tip


def test_distance_of_every_frame_equals_independent_arithmetic(folder, manifest, steps, tips):
    stylus = trimesh.load(folder / "stylus.stl")
    center = np.reshape(manifest["tumor"]["pose"]["matrix"], (4, 4))[:, 3]
    in_tip = np.ascontiguousarray((np.linalg.inv(tips) @ center)[:, :3])
    squared = igl.point_mesh_squared_distance(in_tip, stylus.vertices, stylus.faces)[0]
    found = [step.decision.proximity.signed_distance_mm for step in steps]
    # The sphere of triangles is up to 0.03 mm inside the true one, and the reader projects printed
    # matrices to rotations; the engine's own tolerance grows with the distance.
    np.testing.assert_allclose(found, np.sqrt(squared) - RADIUS_MM, atol=0.05, rtol=0.002)


def test_breach_is_found_at_the_times_of_the_recording(folder, steps, manifest):
    stale_ns = manifest["margins"]["stale_after_ms"] * 1_000_000
    (breach,) = find_breaches([ReportRow.from_step(step) for step in steps], stale_ns)
    expected = yaml.safe_load((folder / "expected.yaml").read_text())
    (interval,) = expected["breaches"]["intervals"]
    assert len(steps) == expected["frames"]
    assert all(step.decision.state is not mg.MarginState.UNKNOWN for step in steps)
    times = np.array(igsio_times_s(folder / "tracking.igs.mha"))
    assert breach.start_s == pytest.approx(interval["start_s"], abs=1e-4)
    assert breach.end_s == pytest.approx(times[breach.last] - times[0], abs=1e-4)
    deepest_mm = pytest.approx(interval["min_signed_distance_mm"], abs=0.04)
    assert breach.min_signed_distance_mm == deepest_mm


def test_arm_holds_the_recorded_tip_wherever_it_reaches(manifest, steps, tips):
    reference_from_base = np.reshape(manifest["registration"]["matrix"], (4, 4))
    followed = [
        (step.links["stylus"], tip) for step, tip in zip(steps, tips, strict=True) if step.links
    ]
    assert len(steps) - len(followed) == OUT_OF_REACH
    for link, tip in followed:
        held = reference_from_base @ link.matrix
        # Matrices of the recording are rotations to 1e-4 only, which moves the tip by 0.04 mm.
        np.testing.assert_allclose(held[:3, 3], tip[:3, 3], atol=0.1)
        np.testing.assert_allclose(held[:3, :3], tip[:3, :3], atol=1e-3)


def test_files_are_those_of_the_script(folder, tmp_path, monkeypatch):
    """`make_case.py` computes the truth by other arithmetic than the tests above."""
    write = runpy.run_path(str(folder / "make_case.py"))["main"]
    monkeypatch.setitem(write.__globals__, "FOLDER", tmp_path)
    write()
    for name in ("case.yaml", "expected.yaml"):
        assert (tmp_path / name).read_text() == (folder / name).read_text()
    for name in ("stylus.stl", "sphere.stl"):
        written, shipped = (trimesh.load(each / name) for each in (tmp_path, folder))
        np.testing.assert_allclose(written.triangles, shipped.triangles, atol=1e-5)
