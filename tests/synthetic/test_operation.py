"""The simulated operation: its phases on request, its images, its files and its truth."""

import numpy as np
import pytest
import yaml

from app.case import open_live
from app.files.meshes import load_mesh
from app.geometry import InputError, Transform
from app.synthetic.motion import TouchArm
from app.synthetic.operation import (
    PIXEL_MM,
    PLANES,
    RATE_HZ,
    Operation,
    OperationMoment,
    UltrasoundSlice,
    operation_truth,
    probe_from_image,
)
from app.synthetic.operation_files import write_operation

pytestmark = pytest.mark.slow

MAX_STEPS = round(60.0 * RATE_HZ)


class Played:
    """An operation whose phases are played to their end."""

    def __init__(self, seed: int = 1) -> None:
        self.truth = operation_truth(seed)
        self.reached: list[str] = []
        arm = TouchArm()
        self.operation = Operation(self.truth, arm, seed, self.reached.append)

    def play(self, phase: str) -> list[OperationMoment]:
        """The moments until ``phase`` is reported."""
        self.operation.request(phase)
        before, moments = len(self.reached), list[OperationMoment]()
        while len(self.reached) == before:
            moments.append(self.operation.step())
            assert len(moments) < MAX_STEPS
        assert self.reached[-1] == phase
        return moments

    def distances_mm(self, moments: list[OperationMoment]) -> list[float]:
        """Distance of the true tip from the true surface along its ray, negative inside."""
        truth, found = self.truth, []
        for moment in moments:
            poses = {pose.source: pose for pose in moment.poses}
            tip = poses["cautery"].apply(truth.tool_from_tip.translation_mm)
            tumor = poses["needle"] @ truth.sensor_from_tumor
            place = tumor.inverse().apply(tip)
            radius = float(np.linalg.norm(place))
            found.append(radius - float(truth.tumour.radius_mm((place / radius)[None])[0]))
        return found


@pytest.fixture(scope="module")
def touched() -> list[OperationMoment]:
    return Played().play("touch")


def test_phases_reach_their_end_and_the_breach_is_in_the_true_tumour():
    played = Played()
    for phase in ("pivot", "spin", "sweep 0"):
        played.play(phase)
    assert min(played.distances_mm(played.play("approach"))) > 4.0
    assert min(played.distances_mm(played.play("breach"))) == pytest.approx(-3.0, abs=0.5)
    assert played.distances_mm(played.play("retreat"))[-1] > 30.0


def test_the_same_seed_and_requests_give_the_same_moments(touched):
    second = Played().operation
    second.request("touch")
    for one in touched[:150]:
        other = second.step()
        assert [p.matrix.tolist() for p in one.poses] == [p.matrix.tolist() for p in other.poses]
        assert one.joints == other.joints
        assert np.array_equal(one.image, other.image)
    others = Played(2)
    others.operation.request("touch")
    assert others.operation.step().poses[1].matrix.tolist() != touched[0].poses[1].matrix.tolist()


def test_arm_and_tool_touch_the_same_points(touched):
    truth = operation_truth(1)
    arm = TouchArm()
    for moment in touched[::40]:
        poses = {pose.source: pose for pose in moment.poses}
        tip = poses["cautery"].apply(truth.tool_from_tip.translation_mm)
        touched_mm = arm.base_from_tool(moment.joints).translation_mm
        reference = poses["reference"].inverse().apply(tip)
        assert np.linalg.norm(reference - truth.reference_from_base.apply(touched_mm)) < 1.0


def test_image_shows_the_cut_through_the_true_tumour():
    truth = operation_truth(1)
    slices = UltrasoundSlice(truth.tumour, np.random.default_rng(1))
    pose = Transform("tumor", "probe", np.eye(3), np.zeros(3))
    pixels = np.mean([slices.image(pose) for _ in range(40)], axis=0)
    angles = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    around = np.column_stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)])
    area_mm2 = 0.5 * np.sum(truth.tumour.radius_mm(around) ** 2) * (angles[1] - angles[0])
    assert (pixels < 75.0).sum() * PIXEL_MM**2 == pytest.approx(area_mm2, rel=0.02)
    row, column = np.argwhere(pixels < 75.0).mean(axis=0)
    centre = probe_from_image() @ [column, row, 0.0, 1.0]
    assert np.abs(centre[:2]).max() < truth.tumour.max_radius_mm / 4.0


@pytest.mark.parametrize("phase", ["", "dance", "sweep", "sweep 9", "sweep -1", "pivot 2"])
def test_unknown_phase_is_refused_and_changes_nothing(phase):
    played = Played()
    with pytest.raises(InputError, match=r"expected (one of rest, pivot|a plane from 0 to 8)"):
        played.operation.request(phase)
    played.operation.step()
    assert played.reached == []
    assert PLANES == 9


def test_files_are_a_live_session_with_errors_and_the_truth_beside_it(tmp_path):
    truth = operation_truth(3)
    write_operation(tmp_path / "operation", truth)
    live = open_live(tmp_path / "operation" / "live.yaml")
    manifest = live.case.manifest
    error_mm = manifest.tool.tool_from_tip.translation_mm - truth.tool_from_tip.translation_mm
    assert np.linalg.norm(error_mm) == pytest.approx(2.0)
    assert live.case.tumor_mesh().bounds_mm[1] == pytest.approx(5.0, abs=0.1)
    known = yaml.safe_load((tmp_path / "operation" / "truth" / "truth.yaml").read_text())
    assert known["tool_from_tip"]["matrix"] == truth.tool_from_tip.matrix.ravel().tolist()
    path = tmp_path / "operation" / "truth" / "tumor.stl"
    surface = load_mesh(path, units="mm", frame="tumor").require_closed("the true tumour")
    radius = np.linalg.norm(surface.vertices_mm, axis=1)
    assert radius == pytest.approx(
        truth.tumour.radius_mm(surface.vertices_mm / radius[:, None]), abs=1e-4
    )
    with pytest.raises(InputError, match="already exists"):
        write_operation(tmp_path / "operation", truth)
