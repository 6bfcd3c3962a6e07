"""Insertion metrics of a recorded hand, compared with arithmetic on the text of the recording."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

import marginguard as mg
from app.analysis import analyse_case, insertion_metrics
from app.geometry import InputError
from tests.oracles.igsio_text import igsio_samples, igsio_times_s


def rigid(matrices: np.ndarray) -> np.ndarray:
    """The printed matrices (n, 4, 4) with the nearest rotations."""
    left, _, right = np.linalg.svd(matrices[:, :3, :3])
    found = matrices.copy()
    found[:, :3, :3] = left @ right
    return found


def test_metrics_of_the_phantom_case_equal_independent_arithmetic(project_root: Path):
    folder = project_root / "data" / "phantom_case"
    case = mg.open_case(folder, tip_only=True)
    content = case.content
    found = analyse_case(
        mg.replay(case), name="phantom", margins=content.margins, tumor=content.tumor
    ).insertion

    manifest = yaml.safe_load((folder / "case.yaml").read_text())
    recording = folder / "tracking.igs.mha"
    reference, stylus = (
        rigid(igsio_samples(recording, f"{name}ToTracker").matrices)
        for name in ("Reference", "Stylus")
    )
    tip = np.reshape(manifest["tool"]["tip_from"]["matrix"], (4, 4))[:, 3]
    centre = np.reshape(manifest["tumor"]["pose"]["matrix"], (4, 4))[:3, 3]
    tips = (np.linalg.inv(reference) @ stylus @ tip)[:, :3]
    times = igsio_times_s(recording)
    path = tissue_path = tissue_s = 0.0
    for k in range(1, len(tips)):
        step = float(np.sqrt(((tips[k] - tips[k - 1]) ** 2).sum()))
        path += step
        if np.linalg.norm(tips[k] - centre) < 10.0:
            tissue_path += step
            tissue_s += times[k] - times[k - 1]
    assert tissue_s > 0.5
    assert found.elapsed_s == pytest.approx(times[-1] - times[0], rel=1e-3)
    assert found.path_mm == pytest.approx(path, rel=1e-3)
    assert found.tissue_s == pytest.approx(tissue_s, rel=1e-3)
    assert found.tissue_path_mm == pytest.approx(tissue_path, rel=1e-3)


def test_damage_of_the_phantom_case_equals_a_sphere_in_closed_form(project_root: Path):
    """The tissue is a ball of 10 mm, whose surface is a mesh in the case."""
    folder = project_root / "data" / "phantom_case"
    case = mg.open_case(folder, tip_only=True)
    content = case.content
    found = analyse_case(
        mg.replay(case), name="phantom", margins=content.margins, tumor=content.tumor
    ).insertion.tissue_damage_mm2
    manifest = yaml.safe_load((folder / "case.yaml").read_text())
    reference, stylus = (
        igsio_samples(folder / "tracking.igs.mha", f"{name}ToTracker").matrices
        for name in ("Reference", "Stylus")
    )
    tip = np.reshape(manifest["tool"]["tip_from"]["matrix"], (4, 4))
    centre = np.reshape(manifest["tumor"]["pose"]["matrix"], (4, 4))[:3, 3]
    poses = np.linalg.inv(reference) @ stylus @ tip
    area, before = 0.0, None
    for pose in poses:
        place, back = pose[:3, 3] - centre, -pose[:3, 2]
        if place @ place >= 100.0:
            before = None
            continue
        along = place @ back
        out = place + (math.sqrt(along**2 - place @ place + 100.0) - along) * back
        if before is not None:
            for one, other in (
                (place - before[0], out - before[0]),
                (before[1] - out, before[0] - out),
            ):
                area += 0.5 * math.sqrt((one @ one) * (other @ other) - (one @ other) ** 2)
        before = place, out
    assert area > 20.0
    assert found == pytest.approx(area, rel=0.01)


def test_a_step_counts_by_its_end():
    times = np.array([0.0, 1.0, 3.0, 6.0])
    tips = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [3.0, 0.0, 0.0], [7.0, 0.0, 0.0]])
    found = insertion_metrics(times, tips, np.array([-1.0, 1.0, -1.0, 1.0]))
    assert (found.elapsed_s, found.path_mm) == (6.0, 7.0)
    assert (found.tissue_s, found.tissue_path_mm) == (2.0, 2.0)


def test_unknown_frames_are_left_out():
    times = np.array([0.0, 1.0, 2.0])
    tips = np.array([[0.0, 0.0, 0.0], [np.nan] * 3, [2.0, 0.0, 0.0]])
    found = insertion_metrics(times, tips, np.array([1.0, np.nan, -1.0]))
    assert (found.elapsed_s, found.path_mm, found.tissue_s) == (2.0, 2.0, 2.0)


def test_other_shapes_are_refused():
    with pytest.raises(InputError, match="expected"):
        insertion_metrics(np.zeros(2), np.zeros((3, 3)), np.zeros(2))
