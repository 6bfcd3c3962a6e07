"""The recorded case in the module's logic on the real MRML, compared with a replay."""

import csv
from collections import Counter

import numpy as np
import pytest
import slicer

from app.fixture import MarginState
from app.geometry import MarginGuardError
from app.report import ReplayLog
from app.report.rows import margin_csv
from app.runtime import OperatorCommands, StepTiming
from app.scene import Preset, load_scene, save_scene
from app.scene.convert import world_points
from app.session import Session
from tests.shipped_case import BRIEF, DEEP, SHAFT, STALE_AFTER_S, middle_s
from tests.slicer_module.marginguard_module import (
    CASE,
    CLEAR_S,
    INVALID,
    MISSING,
    SILENT,
    STATUS_NS,
    PanelLogic,
    frame_times_s,
    node_of,
    show,
    spin_until,
    step,
    tumor_color,
)
from tests.waiting import wait_until

pytestmark = pytest.mark.slow

GREY, RED = MarginState.UNKNOWN.color, MarginState.POSITIVE.color
BREACH_S, INVALID_S = middle_s(DEEP), middle_s(INVALID)
NEAR_S = 5.0
MOMENTS_S = {
    "clear": CLEAR_S,
    "invalid": INVALID_S,
    "silent": SILENT["start_s"] + 0.9 * STALE_AFTER_S,
    "breach": BREACH_S,
    "missing": middle_s(MISSING),
    "brief": middle_s(BRIEF),
    "shaft": middle_s(SHAFT),
}


@pytest.fixture(scope="module")
def rows(recorded):
    """Rows of a replay's ``margin.csv`` by time in s; a seek in the panel starts a new session."""
    session, log = Session(recorded.case.setup), ReplayLog()
    for frame in recorded.case.case.frames():
        log.publish(session.step(frame), StepTiming())
    times_s = [round(seconds, 3) for seconds in frame_times_s(recorded)]
    rows = dict(zip(times_s, csv.DictReader(margin_csv(log.rows).splitlines()), strict=True))
    assert {row["state"] for row in rows.values()} == set(MarginState.__members__)
    return rows


@pytest.fixture
def panel_logic(replayed):
    return replayed


def world_matrix(node):
    return slicer.util.arrayFromTransformMatrix(node, toWorld=True)


def markups(application, points_mm):
    node = application.scene.AddNewNodeByClass("vtkMRMLMarkupsFiducialNode")
    for point in points_mm.tolist():
        node.AddControlPoint(point)
    return node


def line(application):
    return node_of(application, "ClosestPoints").GetDisplayNode()


def test_nodes_agree_with_row_of_replay(panel_logic, application, rows):
    for seconds in MOMENTS_S.values():
        check_nodes(show(panel_logic, seconds), application, rows)


def check_nodes(status, application, rows):
    row = rows[round(status.position_s, 3)]
    known = row["state"] != "UNKNOWN"
    state = MarginState[row["state"]]
    assert status.state is state
    assert tumor_color(application) == state.color
    assert line(application).GetVisibility() == known
    assert status.banner == node_of(application, "MarginStatus").GetText()
    if not known:
        return
    banner_mm = float(status.banner.split(", ")[1].removesuffix(" mm"))
    assert banner_mm == pytest.approx(float(row["signed_distance_mm"]), abs=0.06)
    # The tip in the tumour's coordinates, through the scene's own transforms.
    tip, tumor = (node_of(application, name) for name in ("CauteryTipToCautery", "TumorToNeedle"))
    between = np.linalg.inv(world_matrix(tumor)) @ world_matrix(tip)
    assert between[:3, 3] == pytest.approx(
        [float(row[f"tip_{axis}_mm"]) for axis in "xyz"], abs=1e-6
    )


def test_states_of_single_steps_equal_those_of_replay(panel_logic, application, rows):
    status = show(panel_logic, DEEP["start_s"] - 0.2)
    states = []
    for _ in range(60):  # into the first breach and out of it
        status = step(panel_logic)
        states.append(status.state)
        assert status.state.name == rows[round(status.position_s, 3)]["state"], status
        assert tumor_color(application) == status.state.color
    assert {MarginState.WARNING, MarginState.POSITIVE} <= set(states)
    markers = node_of(application, "BreachMarkers")
    assert markers.GetNumberOfControlPoints() > 0


def test_step_pauses_rendering_once(panel_logic, application):
    status = show(panel_logic, BREACH_S)
    events = []
    for event in ("PauseRenderEvent", "ResumeRenderEvent"):
        number = getattr(slicer.vtkMRMLApplicationLogic, event)
        application.logic.AddObserver(number, lambda *_, event=event: events.append(event))
    before = status.position_s
    panel_logic.step()
    while panel_logic.session.position_s == before:
        events.clear()
        panel_logic.refresh(0.02)
    assert events == ["PauseRenderEvent", "ResumeRenderEvent"]


def test_ended_replay_ages_until_tumour_is_grey(panel_logic, application, clock, recorded):
    show(panel_logic, frame_times_s(recorded)[-5])
    assert tumor_color(application) != GREY
    panel_logic.play()
    status = spin_until(panel_logic, lambda now: not now.has_session)
    assert status.session.endswith("ended")
    clock.ns += round((STALE_AFTER_S + 0.001) * 1e9)
    status = panel_logic.refresh(0.0)
    assert status.state is MarginState.UNKNOWN
    assert status.banner.startswith("UNKNOWN: not to be trusted, data 0.1 s old")
    assert status.reasons == "stale"
    assert tumor_color(application) == GREY
    panel_logic.play()  # from the beginning
    spin_until(panel_logic, lambda now: now.is_playing and now.position_s < 5.0)


def test_paused_replay_does_not_age_but_stalled_replay_does(panel_logic, application, clock):
    show(panel_logic, BREACH_S)
    clock.ns += 10_000_000_000
    panel_logic.refresh(0.0)
    assert tumor_color(application) == RED

    # Within the lock the worker cannot step.
    with panel_logic.session.thread.run.between_steps():
        panel_logic.play()
        clock.ns += round((STALE_AFTER_S + 0.001) * 1e9)
        status = panel_logic.refresh(0.0)
        assert status.state is MarginState.UNKNOWN
        assert tumor_color(application) == GREY
        assert not line(application).GetVisibility()
        assert "stale" in status.trackers
    spin_until(panel_logic, lambda now: now.state is MarginState.POSITIVE)


def test_margins_change_together_and_survive_seek(panel_logic, application):
    assert show(panel_logic, NEAR_S).state is MarginState.NEGATIVE
    with pytest.raises(MarginGuardError, match="warn_mm is 5; expected more than stop_mm 9"):
        panel_logic.set_margins(9.0, 5.0)
    assert panel_logic.margins().stop_mm == 1.0
    panel_logic.set_margins(2.0, 150.0)
    panel_logic.step()
    spin_until(panel_logic, lambda now: now.state is MarginState.WARNING)
    assert show(panel_logic, 6.0).state is MarginState.WARNING
    assert panel_logic.margins().warn_mm == 150.0


def test_model_replaces_tumour(panel_logic, application):
    """The tool is inside a sphere around its tip, and was clear of the tumour before."""
    from vtkmodules.vtkFiltersSources import vtkSphereSource

    show(panel_logic, NEAR_S)
    ball = vtkSphereSource()
    ball.SetRadius(8.0)
    ball.SetThetaResolution(24)
    ball.SetPhiResolution(24)
    tip = node_of(application, "CauteryTipToCautery")
    ball.SetCenter(world_matrix(tip)[:3, 3])
    ball.Update()
    model = application.scene.AddNewNodeByClass("vtkMRMLModelNode", "Ball")
    model.SetAndObservePolyData(ball.GetOutput())
    with pytest.raises(MarginGuardError, match="tumour: no node is selected"):
        panel_logic.set_tumor(None)
    panel_logic.set_tumor(model)
    panel_logic.step()
    status = spin_until(panel_logic, lambda now: "sha256" in now.message)
    panel_logic.step()
    status = spin_until(
        panel_logic, lambda now: now.state is not MarginState.UNKNOWN and "latched" in now.reasons
    )
    assert status.state is MarginState.POSITIVE
    assert status.shown.key == "POSITIVE"  # worse than the hold
    assert status.banner.endswith("; HOLD until re-armed")
    assert "hold: tumour replaced: " in status.reasons
    assert "IT DOES NOT OVERLAP THE FORMER TUMOUR" in status.reasons
    shown = node_of(application, "Tumor")
    bounds = np.reshape(shown.GetPolyData().GetBounds(), (3, 2))
    assert bounds[:, 1] - bounds[:, 0] == pytest.approx(16.0, abs=0.3)
    # Only an operator ends the latched hold.
    assert "latched" in status.reasons
    panel_logic.rearm()
    assert "latched" not in step(panel_logic).reasons


def test_rearm_is_refused_while_displayed_margin_is_unknown(panel_logic):
    show(panel_logic, INVALID_S)
    with pytest.raises(MarginGuardError, match="the displayed margin is UNKNOWN"):
        panel_logic.rearm()


def test_rearm_is_refused_after_fault_that_was_not_displayed(panel_logic, recorded):
    """The planned dropout of the tool begins and ends between two spins of the panel."""
    before_s, after_s = INVALID["start_s"] - 0.5, INVALID["end_s"] + 1.0
    assert show(panel_logic, before_s).state is not MarginState.UNKNOWN
    player = panel_logic.session.replay().player
    begun_ns = player.time_ns
    # Through the dropout, without a spin.
    player.step(sum(before_s < each < after_s for each in frame_times_s(recorded)))
    wait_until(lambda: player.time_ns - begun_ns > 1e9 * (after_s - before_s - 0.1))
    with pytest.raises(MarginGuardError, match="nonce is 0: not that of the present hold"):
        panel_logic.rearm()
    status = spin_until(panel_logic, lambda now: now.position_s >= after_s)
    assert status.state is not MarginState.UNKNOWN
    assert "latched" in status.reasons
    assert status.shown.key == "HOLD"
    assert status.banner.startswith(f"HOLD until re-armed; margin {status.state.name}: ")
    panel_logic.rearm()
    panel_logic.step()
    spin_until(panel_logic, lambda now: "latched" not in now.reasons)


def test_rearm_is_refused_after_margin_change_that_was_not_displayed(panel_logic):
    show(panel_logic, NEAR_S)
    panel_logic.set_margins(0.5, 4.0)
    assert panel_logic.margins().stop_mm > 0.5  # looser margins wait for the re-arm
    with pytest.raises(MarginGuardError, match="nonce is 0: not that of the present hold"):
        panel_logic.rearm()
    panel_logic.step()
    status = spin_until(panel_logic, lambda now: "latched" in now.reasons)
    assert "hold: stop_mm lowered from 1 to 0.5, warn_mm lowered from 5 to 4" in status.reasons
    assert "rearm from the panel REFUSED: " in status.request  # the request after the change
    panel_logic.rearm()
    assert panel_logic.margins().stop_mm == 0.5
    assert "rearm from the panel accepted: " in panel_logic.refresh().request


def first_display(node):
    return node.GetDisplayNode()


def test_deleted_node_makes_panel_unknown_until_next_step(panel_logic, application):
    deleted = (
        ("Tumor", None),
        ("Tumor", first_display),
        ("MarginStatus", None),
        ("NeedleToReference", None),
    )
    for name, of in deleted:
        check_deletion(panel_logic, application, name, of)


def check_deletion(panel_logic, application, name, of):
    assert show(panel_logic, NEAR_S).state is MarginState.NEGATIVE
    node = node_of(application, name)
    application.scene.RemoveNode(node if of is None else of(node))
    status = panel_logic.refresh(0.0)
    assert status.state is MarginState.UNKNOWN
    assert status.banner.startswith("UNKNOWN: nothing is shown, ")
    assert name in status.message
    for left in ("Tumor", "MarginStatus", "ClosestPoints"):
        assert node_of(application, left) is None
    with pytest.raises(MarginGuardError, match="UNKNOWN"):
        panel_logic.rearm()
    panel_logic.step()
    spin_until(panel_logic, lambda now: now.state is MarginState.NEGATIVE)
    assert tumor_color(application) == MarginState.NEGATIVE.color


def test_foreign_colour_is_read_as_unknown(panel_logic, application):
    show(panel_logic, NEAR_S)
    node_of(application, "Tumor").GetDisplayNode().SetColor(0.2, 0.4, 0.9)
    assert panel_logic.session.readout()[0] is MarginState.UNKNOWN
    assert panel_logic.refresh(0.0).state is MarginState.NEGATIVE  # and is overwritten


def test_status_is_due_in_another_state_and_after_its_interval(panel_logic, monkeypatch):
    now_ns = [10**9]
    monkeypatch.setattr(panel_logic, "_clock_ns", lambda: now_ns[0])
    show(panel_logic, NEAR_S)
    assert panel_logic.spin() is None
    now_ns[0] += STATUS_NS
    assert panel_logic.spin().state is MarginState.NEGATIVE
    assert panel_logic.spin() is None
    panel_logic.seek(middle_s(DEEP))
    wait_until(lambda: panel_logic.spin() is not None)
    assert panel_logic.session.readout()[0] is MarginState.POSITIVE
    now_ns[0] -= STATUS_NS  # a clock that is set back
    assert panel_logic.spin() is not None


def test_tumour_for_ended_session_is_reported_as_not_set(panel_logic, application, monkeypatch):
    monkeypatch.setattr(OperatorCommands, "set_tumor", lambda *_, **__: "model id")
    panel_logic.set_tumor(markups(application, 10.0 * np.vstack([np.eye(3), -np.eye(3)])))
    panel_logic.seek(NEAR_S)
    status = spin_until(panel_logic, lambda now: now.message and "..." not in now.message)
    assert "another session has started; expected the same one: set it again" in status.message


def test_registrations_from_case_and_from_landmarks_agree(panel_logic, application, recorded):
    panel_logic.register_case(recorded.case.case.folder)
    status = spin_until(panel_logic, lambda now: now.can_accept)
    assert status.registration.startswith("paired points, 8 points, FRE 0.")
    known = recorded.case.setup.robot.registration.transform
    assert panel_logic.candidate.transform.translation_mm == pytest.approx(known.translation_mm)
    panel_logic.accept_registration()
    spin_until(panel_logic, lambda now: now.message == "the registration is in use")
    with pytest.raises(MarginGuardError, match="no registration to accept"):
        panel_logic.accept_registration()

    base_mm = np.array([[0, 0, 0], [90, 0, 0], [0, 80, 0], [0, 0, 70], [60, 60, 10.0]])
    nodes = [markups(application, points_mm) for points_mm in (known.apply(base_mm), base_mm)]
    with pytest.raises(MarginGuardError, match="landmarks: a list is not chosen; expected two"):
        panel_logic.register_landmarks(nodes[0], None)
    panel_logic.register_landmarks(*nodes)
    assert panel_logic.candidate.accepted, panel_logic.candidate.reason
    assert panel_logic.candidate.transform.matrix == pytest.approx(known.matrix, abs=1e-6)


def test_views_opacity_and_patient_to_ras(panel_logic, application):
    with pytest.raises(MarginGuardError, match="no 3D view"):
        panel_logic.view.look_from(Preset.ANTERIOR)
    camera = application.scene.AddNewNodeByClass("vtkMRMLCameraNode")
    panel_logic.view.look_from(Preset.SUPERIOR)
    towards = np.array(camera.GetPosition()) - np.array(camera.GetFocalPoint())
    assert towards / np.linalg.norm(towards) == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)

    show(panel_logic, NEAR_S)
    panel_logic.view.follow_tool(True)
    tip = node_of(application, "CauteryTipToCautery")
    here = world_matrix(tip)[:3, 3]
    assert camera.GetFocalPoint() == pytest.approx(here, abs=1e-6)
    show(panel_logic, BREACH_S)
    there = world_matrix(tip)[:3, 3]
    assert np.linalg.norm(there - here) > 10.0
    assert camera.GetFocalPoint() == pytest.approx(there, abs=1e-6)
    panel_logic.view.look_from(Preset.LEFT)
    assert not panel_logic.view.follows_tool

    panel_logic.view.keep_centred(True)
    model = node_of(application, "Tumor")
    middle = world_points(model).mean(axis=0)
    assert camera.GetFocalPoint() == pytest.approx(middle, abs=1e-6)
    camera.SetFocalPoint(0.0, 0.0, 0.0)
    panel_logic.refresh()
    assert camera.GetFocalPoint() == pytest.approx(middle, abs=1e-6)
    panel_logic.view.follow_tool(True)
    assert not panel_logic.view.keeps_tumor
    panel_logic.view.look_from(Preset.LEFT)
    panel_logic.view.set_opacity(0.9)
    tumor = node_of(application, "Tumor")
    assert tumor.GetDisplayNode().GetOpacity() == 0.9
    patient = application.scene.AddNewNodeByClass("vtkMRMLLinearTransformNode")
    slicer.util.updateTransformMatrixFromArray(
        patient, np.block([[np.eye(3), np.array([[100.0], [0], [0]])], [0, 0, 0, 1]])
    )
    panel_logic.view.set_patient_to_ras(patient)
    moved = world_matrix(tip)[:3, 3]
    assert moved - there == pytest.approx([100.0, 0.0, 0.0], abs=1e-9)
    assert panel_logic.refresh().state is MarginState.POSITIVE  # only the display has changed
    with pytest.raises(
        MarginGuardError, match="CauteryToReference is below ReferenceToRas; expected"
    ):
        panel_logic.view.set_patient_to_ras(node_of(application, "CauteryToReference"))
    panel_logic.view.set_patient_to_ras(None)
    assert world_matrix(tip)[:3, 3] == pytest.approx(there)


def test_invalid_commands_raise_and_later_errors_are_one_line(panel_logic, recorded, tmp_path):
    last_s = frame_times_s(recorded)[-1]
    for command, message in (
        (lambda: panel_logic.seek(last_s + 1.0), f"expected 0 to {last_s:.1f} s"),
        (lambda: panel_logic.set_rate(-1.0), r"rate of a replay is -1\.0; expected"),
        (lambda: panel_logic.load_case(tmp_path / "none"), "no such folder"),
    ):
        with pytest.raises(MarginGuardError, match=message):
            command()
    panel_logic.register_case(tmp_path)
    status = spin_until(panel_logic, lambda now: "..." not in now.message and now.message)
    assert status.message.startswith("registering: ")
    assert "\n" not in status.message


def names_in(scene):
    """Counts of the names of displayable nodes and transforms."""
    nodes = [scene.GetNthNode(place) for place in range(scene.GetNumberOfNodes())]
    return Counter(node.GetName() for node in nodes if node.IsA("vtkMRMLTransformableNode"))


def test_session_adopts_nodes_of_reloaded_scene(panel_logic, application, clock, tmp_path):
    show(panel_logic, 1.0)
    scene = application.scene
    before = names_in(scene)
    save_scene(scene, tmp_path / "case.mrb")
    panel_logic.close()
    load_scene(scene, tmp_path / "case.mrb")
    tumor = scene.GetFirstNodeByName("Tumor")
    again = PanelLogic(scene, application.logic, clock)
    again.load_case(CASE)
    spin_until(again, lambda now: now.position_s is not None)
    assert before["Tumor"] == before["CauteryToReference"] == 1
    assert names_in(scene) == before
    assert scene.GetFirstNodeByName("Tumor") is tumor
    again.close()


def test_close_removes_all_nodes(panel_logic, application):
    before = {"Selection", "Interaction", "SubjectHierarchy"}
    panel_logic.close()
    scene = application.scene
    names = {scene.GetNthNode(place).GetName() for place in range(scene.GetNumberOfNodes())}
    assert names <= before


def test_deleted_markers_leave_the_list_of_breaches(panel_logic, application):
    show(panel_logic, BREACH_S)
    markers = node_of(application, "BreachMarkers")
    assert markers.GetNumberOfControlPoints() == 1
    panel_logic.view.set_markers(2.0, 4.0)
    assert markers.GetDisplayNode().GetGlyphSize() == 4.0
    listed = panel_logic.events.breach_rows()
    panel_logic.view.delete_markers()
    assert markers.GetNumberOfControlPoints() == 0
    assert panel_logic.events.breach_rows() == listed and listed
    with pytest.raises(MarginGuardError, match=r"least distance 0 mm; expected 0\.2 to 20 mm"):
        panel_logic.view.set_markers(0.0, 1.0)
