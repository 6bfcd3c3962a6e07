"""Insertion metrics of a recorded hand, compared with arithmetic on the text of the recording."""

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

import marginguard as mg
from app.analysis import CaseSamples, analyse_case, case_insertion, insertion_metrics
from app.geometry import InputError, SurfaceMesh
from tests.oracles.igsio_text import igsio_samples, igsio_times_s

pytestmark = pytest.mark.slow


def rigid(matrices: np.ndarray) -> np.ndarray:
    """The printed matrices (n, 4, 4) with the nearest rotations."""
    left, _, right = np.linalg.svd(matrices[:, :3, :3])
    found = matrices.copy()
    found[:, :3, :3] = left @ right
    return found


FOLDER = Path(__file__).resolve().parents[2] / "data" / "phantom_case"


@pytest.fixture(scope="module")
def insertion():
    """The analysed insertion of the phantom case, whose tissue is a ball of 10 mm."""
    case = mg.open_case(FOLDER, tip_only=True)
    content = case.content
    return analyse_case(
        mg.replay(case), name="phantom", margins=content.margins, tumor=content.tumor
    ).insertion


@pytest.fixture(scope="module")
def recorded():
    """Matrices (n, 4, 4) of reference and stylus, those of tip and tumour, by the files' text."""
    manifest = yaml.safe_load((FOLDER / "case.yaml").read_text())
    tracked = [
        igsio_samples(FOLDER / "tracking.igs.mha", f"{name}ToTracker").matrices
        for name in ("Reference", "Stylus")
    ]
    tip, tumor = manifest["tool"]["tip_from"]["matrix"], manifest["tumor"]["pose"]["matrix"]
    return *tracked, np.reshape(tip, (4, 4)), np.reshape(tumor, (4, 4))


def test_metrics_of_the_phantom_case_equal_independent_arithmetic(insertion, recorded):
    reference, stylus, tip, tumor = recorded
    tips = (np.linalg.inv(rigid(reference)) @ rigid(stylus) @ tip[:, 3])[:, :3]
    times = igsio_times_s(FOLDER / "tracking.igs.mha")
    path = tissue_path = tissue_s = 0.0
    for k in range(1, len(tips)):
        step = float(np.sqrt(((tips[k] - tips[k - 1]) ** 2).sum()))
        path += step
        if np.linalg.norm(tips[k] - tumor[:3, 3]) < 10.0:
            tissue_path += step
            tissue_s += times[k] - times[k - 1]
    assert tissue_s > 0.5
    assert insertion.elapsed_s == pytest.approx(times[-1] - times[0], rel=1e-3)
    assert insertion.path_mm == pytest.approx(path, rel=1e-3)
    assert insertion.tissue_s == pytest.approx(tissue_s, rel=1e-3)
    assert insertion.tissue_path_mm == pytest.approx(tissue_path, rel=1e-3)


def test_damage_of_the_phantom_case_equals_a_sphere_in_closed_form(insertion, recorded):
    reference, stylus, tip, tumor = recorded
    area, before = 0.0, None
    for pose in np.linalg.inv(reference) @ stylus @ tip:
        place, back = pose[:3, 3] - tumor[:3, 3], -pose[:3, 2]
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
    assert insertion.tissue_damage_mm2 == pytest.approx(area, rel=0.01)


def block(frame: str = "tissue") -> SurfaceMesh:
    """20 x 20 x 20 mm around the origin."""
    made = trimesh.creation.box((20.0, 20.0, 20.0))
    return SurfaceMesh(frame, made.vertices, made.faces)


def test_a_step_counts_by_its_end():
    times = np.array([0.0, 1.0, 3.0, 6.0])
    tips = np.array([[0.0, 0.0, 0.0], [11.0, 0.0, 0.0], [9.0, 0.0, 0.0], [13.0, 0.0, 0.0]])
    found = insertion_metrics(times, tips, block())
    assert (found.elapsed_s, found.path_mm) == (6.0, 17.0)
    assert (found.tissue_s, found.tissue_path_mm) == (2.0, 2.0)


def test_a_step_through_the_tissue_with_both_ends_outside_does_not_count():
    times, tips = np.array([0.0, 1.0]), np.array([[-40.0, 0.0, 0.0], [40.0, 0.0, 0.0]])
    found = insertion_metrics(times, tips, block())
    assert (found.path_mm, found.tissue_s, found.tissue_path_mm) == (80.0, 0.0, 0.0)


def test_each_part_and_each_hollow_of_the_tissue_decide():
    """Two balls, one of them with a hollow."""
    ball, hollow = trimesh.creation.icosphere(4, 10.0), trimesh.creation.icosphere(3, 4.0)
    hollow.invert()
    other = trimesh.creation.icosphere(4, 10.0).apply_translation((30.0, 0.0, 0.0))
    made = trimesh.util.concatenate([ball, hollow, other])
    x = np.linspace(-15.0, 45.0, 601)
    times = 0.01 * np.arange(601)
    tips = np.stack([x, np.full(601, 0.03), np.full(601, 0.02)], axis=1)
    found = insertion_metrics(times, tips, SurfaceMesh("tissue", made.vertices, made.faces))
    assert found.tissue_path_mm == pytest.approx(20.0 - 8.0 + 20.0, abs=0.3)
    assert found.tissue_s == pytest.approx(0.1 * found.tissue_path_mm, rel=1e-9)


def test_the_tip_decides_whatever_the_rest_of_the_tool_does():
    """The shaft stays in the tissue while the tip has left it on the other side."""
    z = np.linspace(-30.0, 30.0, 121)
    distances = np.where(z + 10.0 > 0.0, -1.0, 1.0)
    samples = CaseSamples.from_rows(
        [
            (
                round(1e7 * k),
                0,
                False,
                (d, 1.0, 0.0, 0.0, float(z[k]), *np.eye(3).ravel(), *[0.0] * 9),
            )
            for k, d in enumerate(distances.tolist())
        ]
    )
    found = case_insertion(samples, block("tumor"))
    assert found.tissue_path_mm == pytest.approx(20.0, abs=0.51)
    assert found.tissue_s == pytest.approx(0.4, abs=0.011)


def test_unknown_frames_are_left_out():
    times = np.array([0.0, 1.0, 2.0])
    tips = np.array([[20.0, 0.0, 0.0], [np.nan] * 3, [2.0, 0.0, 0.0]])
    found = insertion_metrics(times, tips, block())
    assert (found.elapsed_s, found.path_mm, found.tissue_s) == (2.0, 18.0, 2.0)


def test_other_shapes_are_refused():
    with pytest.raises(InputError, match="expected"):
        insertion_metrics(np.zeros(2), np.zeros((3, 3)), block())
    with pytest.raises(InputError, match="expected"):
        insertion_metrics(np.arange(3.0), np.zeros((3, 3)), block(), rotations=np.zeros((2, 3, 3)))
