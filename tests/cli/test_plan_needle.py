"""`marginguard plan needle` on the shipped case with three structures, and on a cut of it."""

import json

import numpy as np
import pytest
import trimesh

from app.runtime import prepare_case
from tests.cli.command import refused, run
from tests.cut_case import STRUCTURES_CASE, write_cut_structures

pytestmark = pytest.mark.slow

NEEDLE = ("--length-mm", 120, "--diameter-mm", 1.2, "--bend-mm", 2, "--sigma-mm", 1)
DISC = ("--entry-frame", "reference", "--entry-disc", -15, -133, -27, -0.25, -0.34, 0.9, 40)


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """Seconds of the case; the needle is lost in the last one."""
    return write_cut_structures(tmp_path_factory.mktemp("cut") / "case", 59.0, 2.5)


@pytest.fixture(scope="module")
def prepared(case):
    """The case as each request would prepare it, which takes most of its time."""
    return prepare_case(case, tip_only=True)


def test_plan_has_corridors_with_distances_ids_and_joints(tmp_path):
    out = tmp_path / "plan.json"
    found = run("plan", "needle", STRUCTURES_CASE, *NEEDLE, *DISC, "--robot", "--out", out)
    plan = json.loads(out.read_text())
    assert plan["poses_at_s"] == 0.0
    assert plan["model_id"].startswith("sha256:")
    assert plan["entries"]["count"] == 100_000
    for corridor in plan["corridors"]:
        (wall,) = corridor["structures"]
        assert wall["name"] == "chest_wall"
        assert wall["clearance_mm"] >= wall["required_mm"] == 4.0
        assert corridor["depth_mm"] <= 120.0
        assert len(corridor["joints"]) >= 2
    assert found.out.splitlines() == plan["corridors"][0]["reasons"]


def test_skin_of_a_file_and_a_given_point_at_a_time(case, tmp_path):
    # A skin above the chest wall, as an open surface.
    skin = trimesh.creation.icosphere(4, 60.0, vertex_normals=False)
    skin.apply_translation([-5.0, -119.0, -63.0])
    skin.update_faces(skin.triangles_center[:, 2] > -40.0)
    skin.export(tmp_path / "skin.stl")
    at = ("--at-s", 1, "--target", "lesion_2", "--target-point", 0, 0, 1)
    skin_of_file = ("--entry", tmp_path / "skin.stl", "--entry-frame", "reference")
    found = run("plan", "needle", case, *NEEDLE, *skin_of_file, *at, "--window-mm", 2)
    plan = json.loads(found.out)
    assert 1.0 <= plan["poses_at_s"] < 1.1
    entry = np.array(plan["corridors"][0]["entry_mm"])
    assert np.linalg.norm(entry - [-5.0, -119.0, -63.0]) == pytest.approx(60.0, abs=0.5)
    (target_mm,) = {tuple(each["target_mm"]) for each in plan["corridors"]}
    # A display places the target by this pose.
    assert plan["window_mm"] == 2.0
    placed = np.array(plan["frame_from_target"]) @ [0.0, 0.0, 1.0, 1.0]
    np.testing.assert_allclose(placed[:3], target_mm, atol=1e-9)


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (("--target", "chest_wall"), "target: is 'chest_wall'; expected lesion_2 or tumor"),
        (("--target-point", 0, 0, 50), "mm outside of its structure; expected a point inside"),
        (("--at-s", -1), "--at-s: is -1.0; expected 0 or more"),
        (("--at-s", 1e6), "the recording ends before; expected a time at which"),
        (("--at-s", 2.2), "needle"),
        (("--window-mm", -1), "--window-mm: is -1.0; expected 0 or more"),
        (("--length-mm", 20), "expected at most the length of the needle, 20 mm"),
        (("--length-mm", -1), "needle: length_mm is -1.0; expected more than 0"),
        (("--entry-box", 0, 0, 0, 1, 1, 1), "--entry-box: is of a disc; expected with --entry"),
        (("--target-point", 0, 0, 0, "--sigma-mm", 30), "chest_wall blocks"),
    ],
)
def test_bad_input_is_refused_in_one_line(case, prepared, monkeypatch, words, problem):
    monkeypatch.setattr("app.runtime.prepare_case", lambda *_, **__: prepared)
    assert problem in refused("plan", "needle", case, *NEEDLE, *DISC, *words)
