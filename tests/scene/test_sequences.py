"""Sequences: written and replayed by MRML, read by the reader of cases."""

import numpy as np
import pytest
from slicer import vtkMRMLLinearTransformNode, vtkMRMLScene

from app.case import read_mrml
from app.fixture import MarginState, Reason
from app.geometry import Stamp, TrackedTransform, TrackingStatus
from app.scene import MarginGuardScene, SceneApplication, SceneError, add_sequences, save_scene
from app.scene.convert import vtk_matrix, world_matrix
from tests.scene.conftest import loaded, posed
from tests.scene.scene_content import set_poses

pytestmark = pytest.mark.slow

COUNT = 40
NOW = 25
SIX_DIGITS_MM = 0.0005  # half a unit of the sixth digit, below 1000 mm
START_NS = 1_700_000_000_123_456_789


def stamp(index):
    return Stamp(START_NS + index * 20_000_001)


@pytest.fixture
def frames(edges):
    """The cautery rotates and moves; the needle is lost twice, with different statuses."""
    reference, needle, cautery = edges
    found = []
    for index in range(COUNT):
        motion = posed(
            "cautery", "cautery", [0.0, 0.02 * index, 0.0], [0.0, 0.1 * index, 1.0 / 3.0]
        )
        samples = [
            TrackedTransform(pose, stamp(index), TrackingStatus.OK)
            for pose in (reference, needle, cautery @ motion)
        ]
        if index in (10, 11):
            status = TrackingStatus.INVALID if index == 10 else TrackingStatus.OUT_OF_VIEW
            samples[1] = TrackedTransform.lost("tracker", "needle", stamp(index), status)
        found.append(tuple(samples))
    return found


@pytest.fixture
def states():
    found = [(MarginState.NEGATIVE, ())] * COUNT
    found[20:30] = [(MarginState.POSITIVE, ())] * 10
    found[10:12] = [(MarginState.UNKNOWN, (why,)) for why in (Reason.INVALID, Reason.STALE)]
    return [(stamp(index).ns, *state) for index, state in enumerate(found)]


@pytest.fixture
def recorded_scene(frames, fill, decision):
    scene = fill(MarginGuardScene(SceneApplication(vtkMRMLScene()).scene), has_robot=False)
    set_poses(scene, [sample.transform for sample in frames[NOW] if sample.transform])
    scene.show(decision(MarginState.POSITIVE, -3.25), {})
    return scene


@pytest.fixture
def saved(recorded_scene, frames, states, tmp_path):
    add_sequences(recorded_scene, frames, states, stamp(NOW).ns)
    path = tmp_path / "recording.mrb"
    save_scene(recorded_scene.scene, path)
    return path


def assert_read(path, expected):
    found = list(read_mrml(path, pytest.fail))
    assert [frame.stamp for frame in found] == [samples[0].stamp for samples in expected]
    for frame, samples in zip(found, expected, strict=True):
        by_edge = {(pose.target, pose.source): pose for pose in frame.poses}
        assert by_edge.keys() == {(sample.target, sample.source) for sample in samples}
        for sample in samples:
            read = by_edge[sample.target, sample.source]
            assert read.status is sample.status
            if sample.transform is None or read.transform is None:
                assert read.transform is sample.transform
                continue
            moved = read.transform.translation_mm - sample.transform.translation_mm
            turned = read.transform.rotation - sample.transform.rotation
            assert np.abs(moved).max() <= SIX_DIGITS_MM
            assert np.abs(turned).max() <= 2e-6


def test_case_reads_measured_sequences_and_ignores_derived_ones(saved, frames):
    assert_read(saved, frames)


def test_loaded_scene_shows_the_saved_step_and_can_be_played(saved, recorded_scene, frames):
    application = loaded(saved)
    node = application.scene.GetFirstNodeByName
    cautery = node("CauteryToReference")
    np.testing.assert_allclose(
        world_matrix(cautery), world_matrix(recorded_scene.tree.node("cautery")), atol=1e-9
    )
    assert node("MarginStatus").GetText() == "POSITIVE: in the tumour, -3.2 mm"
    browser = node("MarginGuard")
    assert browser.GetNumberOfItems() == COUNT
    assert browser.GetPlaybackRateFps() == pytest.approx(50.0, abs=1e-3)
    assert browser.GetSelectedItemNumber() == NOW
    for index, color, text, line in (
        (0, MarginState.NEGATIVE.color, "NEGATIVE: clear", False),
        (10, (0.5, 0.5, 0.5), "UNKNOWN: not to be trusted, invalid", False),
        (11, (0.5, 0.5, 0.5), "UNKNOWN: not to be trusted, stale", False),
        (12, MarginState.NEGATIVE.color, "NEGATIVE: clear", False),
        (NOW, MarginState.POSITIVE.color, "POSITIVE: in the tumour, -3.2 mm", True),
        (NOW + 1, MarginState.POSITIVE.color, "POSITIVE: in the tumour", False),
        (COUNT - 1, MarginState.NEGATIVE.color, "NEGATIVE: clear", False),
    ):
        browser.SetSelectedItemNumber(index)
        assert node("Tumor").GetDisplayNode().GetColor() == color
        assert node("MarginStatus").GetText() == text
        assert node("ClosestPoints").GetDisplayNode().GetVisibility() == line
        grey = node("Tool").GetDisplayNode().GetColor() == MarginState.UNKNOWN.color
        assert grey == (text.startswith("UNKNOWN"))
        assert node("ReplayTime").GetText() == f"{index * 0.020000001:.3f} s"
        reference, _, tracked = (sample.transform for sample in frames[index])
        expected = (reference.inverse() @ tracked).matrix
        np.testing.assert_allclose(world_matrix(cautery), expected, atol=2 * SIX_DIGITS_MM)


def test_sequence_names_are_those_of_slicer_igt(saved, recorded_scene):
    measured = ["ReferenceToTracker", "NeedleToTracker", "CauteryToTracker"]
    derived = ["TrackerToReference", "NeedleToReference", "CauteryToReference"]
    names = {f"MarginGuard-{edge}-Seq" for edge in (*measured, *derived)}
    for scene in (recorded_scene.scene, loaded(saved).scene):
        found = {
            scene.GetNthNodeByClass(n, "vtkMRMLSequenceNode").GetName()
            for n in range(scene.GetNumberOfNodesByClass("vtkMRMLSequenceNode"))
        }
        assert names <= found
    measured = recorded_scene.scene.GetFirstNodeByName("MarginGuard-NeedleToTracker-Seq")
    assert (measured.GetIndexName(), measured.GetIndexUnit()) == ("time", "s")
    assert measured.GetNumberOfDataNodes() == COUNT - 2
    assert measured.GetNthIndexValue(1) == "1700000000.143456790"


def test_edge_that_is_measured_late_is_not_marked_as_derived(
    recorded_scene, frames, edges, tmp_path
):
    """The edge is computed in frame 0, measured in frame 1 and lost in frame 2."""
    direct = edges[0].inverse() @ edges[1]
    measured = TrackedTransform(direct, stamp(1), TrackingStatus.OK)
    lost = TrackedTransform.lost("reference", "needle", stamp(2), TrackingStatus.MISSING)
    late = [frames[0], (*frames[1], measured), (*frames[2], lost)]
    add_sequences(recorded_scene, late, [], stamp(0).ns)
    save_scene(recorded_scene.scene, tmp_path / "late.mrb")
    assert_read(tmp_path / "late.mrb", late)


def test_unknown_margin_and_robots_at_other_times_are_not_shown_as_known(
    recorded_scene, frames, states, arm, tmp_path
):
    recorded_scene.add_robot("arm", arm, "robot_base")
    add_sequences(recorded_scene, frames, states[5:], stamp(NOW).ns)
    save_scene(recorded_scene.scene, tmp_path / "late.mrb")
    application = loaded(tmp_path / "late.mrb")
    node = application.scene.GetFirstNodeByName
    for index, state in (
        (NOW, MarginState.POSITIVE),
        (0, MarginState.UNKNOWN),
        (5, MarginState.NEGATIVE),
    ):
        node("MarginGuard").SetSelectedItemNumber(index)
        assert node("Tumor").GetDisplayNode().GetColor() == state.color
        assert node("MarginStatus").GetText().startswith("UNKNOWN") == (index == 0)
        assert node("upper_model").GetDisplayNode().GetVisibility() == (index == NOW)


@pytest.mark.parametrize("storage", [None, "vtkMRMLSequenceStorageNode"])
@pytest.mark.parametrize("named", [True, False])
def test_recordings_of_slicer_are_read(frames, tmp_path, storage, named):
    """The recording is made by MRML alone, like Slicer's sequence browser, in both storages."""
    scene = SceneApplication(vtkMRMLScene()).scene
    for column, edge in enumerate(("ReferenceToTracker", "NeedleToTracker", "CauteryToTracker")):
        sequence = scene.AddNewNodeByClass("vtkMRMLSequenceNode", f"{edge}-Sequence")
        sequence.SetIndexName("time")
        sequence.SetIndexUnit("s")
        if named:
            sequence.SetAttribute("Sequences.Source", edge)
        if storage is not None:
            node = scene.AddNewNodeByClass(storage)
            sequence.SetAndObserveStorageNodeID(node.GetID())
        for samples in frames:
            if samples[column].transform is not None:
                item = vtkMRMLLinearTransformNode()
                item.SetName(edge)
                item.SetMatrixTransformToParent(vtk_matrix(samples[column].transform))
                ns = samples[column].stamp.ns
                sequence.SetDataNodeAtValue(item, f"{ns // 10**9}.{ns % 10**9:09d}")
    path = tmp_path / "recorded.mrb"
    save_scene(scene, path)
    # Slicer records no lost samples.
    assert_read(path, [tuple(s for s in samples if s.transform) for samples in frames])


def test_refused_recording_adds_nothing(recorded_scene, frames, monkeypatch):
    before = recorded_scene.scene.GetNumberOfNodes()
    with pytest.raises(SceneError, match=r"a frame at 1700000000\.\d+ s comes after one at .* s"):
        add_sequences(recorded_scene, [frames[1], frames[0]], [], stamp(0).ns)
    with pytest.raises(SceneError, match="0 good samples"):
        add_sequences(recorded_scene, [], [], stamp(0).ns)
    # Each frame has three edges and three poses in the reference computed from them.
    monkeypatch.setattr("app.scene.sequences.MAX_POSES", 18)
    with pytest.raises(
        SceneError, match=r"more than 18 poses after 0\.060000003 s; expected at most 18"
    ):
        add_sequences(recorded_scene, frames, [], stamp(0).ns)
    assert recorded_scene.scene.GetNumberOfNodes() == before
