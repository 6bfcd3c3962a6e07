"""The scripts of examples/ print what independent computations give."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from tests.examples.conftest import NUMBER, numbers

pytestmark = pytest.mark.long

CASE = Path("data/recorded_case")


def test_check_meshes_measures_as_trimesh_does(run_example, project_root, tmp_path):
    printed = run_example("check_meshes.py", folder=tmp_path)
    tool = trimesh.load_mesh(project_root / CASE / "cautery.stl")
    tumor = trimesh.load_mesh(project_root / CASE / "tumor.stl")
    volumes = numbers(rf", {NUMBER} ml", printed).ravel()
    np.testing.assert_allclose(volumes, [tool.volume / 1e3, tumor.volume / 1e3], atol=0.006)
    # Points of the tool's surface near its tip; trimesh's distance is positive inside.
    tip = tool.slice_plane([0, 0, -3], [0, 0, 1])
    points, _ = trimesh.sample.sample_surface(tip, 750, seed=1)
    for height_mm, distance_mm in numbers(rf"tip +{NUMBER} mm: +{NUMBER} mm", printed):
        placed = points * [1.0, -1.0, -1.0] + [0.0, 0.0, tumor.bounds[1][2] + height_mm]
        nearest = -trimesh.proximity.signed_distance(tumor, placed).max()
        assert -0.5 < distance_mm - nearest < 0.01, height_mm
        assert ("intersect" in printed.split(f"{height_mm:+.1f} mm:")[1].split("\n")[0]) == (
            distance_mm < 0.0
        )


def test_register_points_solves_the_orthogonal_procrustes_problem(run_example, tmp_path):
    from runpy import run_path  # the arrays of the script are the input of the oracle

    printed = run_example("register_points.py", folder=tmp_path)
    script = run_path(str(Path(__file__).parents[2] / "examples" / "register_points.py"))
    fixed, moving = script["in_reference"], script["in_base"]
    rotation, _ = Rotation.align_vectors(fixed - fixed.mean(axis=0), moving - moving.mean(axis=0))
    residuals = np.linalg.norm(
        fixed - fixed.mean(axis=0) - rotation.apply(moving - moving.mean(axis=0)), axis=1
    )
    printed_mm = numbers(rf"residual {NUMBER} mm", printed).ravel()
    np.testing.assert_allclose(printed_mm, residuals, atol=0.006)
    fre_mm, fle_mm = numbers(rf"FRE {NUMBER} mm .*, FLE {NUMBER} mm", printed)[0]
    assert abs(fre_mm - math.sqrt(np.mean(residuals**2))) < 0.006
    # Fitzpatrick, West and Maurer 1998: distances to the principal axes of the landmarks.
    target = script["tumor_in_reference"][0] - fixed.mean(axis=0)
    _, spread, axes = np.linalg.svd(fixed - fixed.mean(axis=0))
    total = float(np.sum(spread**2))
    ratio = sum(
        (target @ target - (axes[k] @ target) ** 2) / ((total - spread[k] ** 2) / len(fixed))
        for k in range(3)
    )
    tre_mm = fle_mm / math.sqrt(len(fixed)) * math.sqrt(1.0 + ratio / 3.0)
    assert abs(numbers(rf"TRE {NUMBER} mm", printed)[0, 0] - tre_mm) < 0.02
    assert "accepted: True" in printed


def test_pivot_calibration_finds_the_tip_and_refuses_the_narrow_swing(run_example, tmp_path):
    printed = run_example("pivot_calibration.py", folder=tmp_path)
    wide, narrow = re.split(r"(?<=\n)(?=swing of)", printed)
    tip = numbers(rf"tip at \({NUMBER}, {NUMBER}, {NUMBER}\) mm", wide)[0]
    assert np.linalg.norm(tip - [2.0, -1.0, 140.0]) < 0.2
    assert "accepted: True" in wide
    assert "accepted: False: the shaft swings" in narrow
    residuals = numbers(rf"residual {NUMBER} mm", printed).ravel()
    assert abs(residuals[0] - residuals[1]) < 0.05


def test_limited_hand_approaches_the_plane_exponentially_and_never_passes_it(run_example, tmp_path):
    printed = run_example("limit_twist.py", folder=tmp_path)
    rows = numbers(rf"{NUMBER} s: +{NUMBER} mm .* at +{NUMBER} of 40.00 mm/s", printed)
    times_s, clearances_mm, speeds_mm_s = rows.T
    assert len(rows) == 11
    # dc/dt = -min(40 mm/s, c / 50 ms): linear down to 2 mm, exponential from there on.
    first_mm = clearances_mm[0]
    slowing_s = (first_mm - 2.0) / 40.0
    expected = np.where(
        times_s < slowing_s, first_mm - 40.0 * times_s, 2.0 * np.exp(-(times_s - slowing_s) / 0.05)
    )
    np.testing.assert_allclose(clearances_mm, expected, atol=0.06)
    assert (clearances_mm >= 0.0).all()
    np.testing.assert_allclose(speeds_mm_s, np.minimum(40.0, clearances_mm / 0.05), atol=0.2)


def test_own_case_has_the_breach_of_two_balls(own_case):
    """The centres pass at 3 mm with 20 mm/s: contact from 5.2 mm before to 5.2 mm after."""
    folder, printed = own_case
    ((start_s, end_s, depth_mm),) = numbers(
        rf"breach from {NUMBER} to {NUMBER} s, {NUMBER} mm deep", printed
    )
    half_s = math.sqrt(6.0**2 - 3.0**2) / 20.0
    assert abs(start_s - (1.0 - half_s)) < 0.021
    assert abs(end_s - (1.0 + half_s)) < 0.021
    assert abs(depth_mm - 3.0) < 0.02
    assert {path.name for path in folder.iterdir()} == {
        "case.yaml",
        "tool.stl",
        "tracking.mcap",
        "tumor.stl",
    }
