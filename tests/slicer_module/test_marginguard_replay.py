"""The recorded case through the module's logic, on the real MRML, beside what a replay writes."""

import csv
import threading
from collections import Counter
from contextlib import contextmanager

import numpy as np
import pytest
import slicer

from app.fixture import MarginState
from app.geometry import MarginGuardError
from app.report import ReplayLog
from app.report.margin_csv import margin_csv
from app.runtime import OperatorCommands, StepThread, StepTiming
from app.scene import Preset, load_scene, save_scene
from app.session import Session
from tests.slicer_module.marginguard_module import CASE, PATIENCE_SPINS, opened_case, spin_until
from tests.slicer_module.marginguard_module import application as application

from MarginGuardLib.logic import PanelLogic  # isort: skip
from MarginGuardLib.jobs import one_line  # isort: skip

GREY, RED = MarginState.UNKNOWN.color, MarginState.POSITIVE.color
RUN_IN_S = 2.0
MOMENTS_S = {
    "clear": 5.0,
    "invalid": 22.3,
    "silent": 25.95,
    "breach": 45.9,
    "missing": 52.5,
    "shaft": 61.0,
    "shaft deep": 70.7,
}


class ClockDouble:
    """TEST DOUBLE of the host's clock: stands still until it is moved."""

    def __init__(self):
        self.ns = 0

    def __call__(self):
        return self.ns


@pytest.fixture(scope="module")
def opened():
    return opened_case()


@pytest.fixture(scope="module")
def rows(opened):
    """The rows of a replay's ``margin.csv`` around each moment, by the second.

    Of one session that comes to each of them from `RUN_IN_S` before; a seek begins a new one there.
    """
    session, log = Session(opened.setup), ReplayLog()
    times_s = []
    for frame in opened.case.frames():
        seconds = (frame.stamp.ns - opened.extent.first_ns) / 1e9
        if any(-RUN_IN_S < seconds - moment < RUN_IN_S for moment in MOMENTS_S.values()):
            log.publish(session.step(frame), StepTiming())
            times_s.append(round(seconds, 3))
    rows = dict(zip(times_s, csv.DictReader(margin_csv(log.rows).splitlines()), strict=True))
    assert {row["state"] for row in rows.values()} == set(MarginState.__members__)
    return rows


@pytest.fixture
def clock():
    return ClockDouble()


@pytest.fixture
def guard(application, opened, clock, monkeypatch):
    """The logic with the case loaded, paused at its beginning; nothing ages by itself."""
    monkeypatch.setattr("MarginGuardLib.logic.prepare_recorded", lambda folder: opened)
    logic = PanelLogic(application.scene, application.logic, clock)
    logic.load_case(CASE)
    spin_until(logic, at(0.0))
    yield logic
    logic.close()


def at(seconds):
    """Whether a status shows the first frame from ``seconds`` on."""
    return lambda status: (
        status.position_s is not None and 0.0 <= status.position_s - seconds < 0.0201
    )


def tumor_color(application):
    return application.scene.GetFirstNodeByName("Tumor").GetDisplayNode().GetColor()


def line(application):
    return application.scene.GetFirstNodeByName("ClosestPoints").GetDisplayNode()


@pytest.mark.parametrize("seconds", MOMENTS_S.values(), ids=MOMENTS_S)
def test_a_moment_has_the_nodes_of_its_row(guard, application, rows, seconds):
    guard.seek(seconds)
    status = spin_until(guard, at(seconds))
    row = rows[round(status.position_s, 3)]
    known = row["state"] != "UNKNOWN"
    state = MarginState[row["state"]]
    assert status.state is state
    assert tumor_color(application) == state.color
    assert line(application).GetVisibility() == known
    assert status.banner == application.scene.GetFirstNodeByName("MarginStatus").GetText()
    if not known:
        return
    said_mm = float(status.banner.split(", ")[1].removesuffix(" mm"))
    assert said_mm == pytest.approx(float(row["signed_distance_mm"]), abs=0.06)
    # The tip in the tumour's coordinates, through the scene's own transforms.
    tip, tumor = (
        application.scene.GetFirstNodeByName(name)
        for name in ("CauteryTipToCautery", "TumorToNeedle")
    )
    found = slicer.util.arrayFromTransformMatrix(tip, toWorld=True)
    between = np.linalg.inv(slicer.util.arrayFromTransformMatrix(tumor, toWorld=True)) @ found
    assert between[:3, 3] == pytest.approx(
        [float(row[f"tip_{axis}_mm"]) for axis in "xyz"], abs=1e-6
    )


def test_frame_by_frame_each_state_is_that_of_the_replay(guard, application, rows):
    guard.seek(45.5)
    status = spin_until(guard, at(45.5))
    seen = []
    for _ in range(80):  # into the first breach and out of it
        before = status.position_s
        guard.step()
        status = spin_until(guard, lambda now, before=before: now.position_s > before)
        seen.append(status.state)
        assert status.state.name == rows[round(status.position_s, 3)]["state"], status
        assert tumor_color(application) == status.state.color
    assert {MarginState.WARNING, MarginState.POSITIVE} <= set(seen)
    markers = application.scene.GetFirstNodeByName("BreachMarkers")
    assert markers.GetNumberOfControlPoints() > 0


def test_a_step_pauses_the_views_once(guard, application):
    guard.seek(45.9)
    status = spin_until(guard, at(45.9))
    events = []
    for event in ("PauseRenderEvent", "ResumeRenderEvent"):
        number = getattr(slicer.vtkMRMLApplicationLogic, event)
        application.logic.AddObserver(number, lambda *_, event=event: events.append(event))
    before = status.position_s
    guard.step()
    while guard.session.position_s == before:
        events.clear()
        guard.spin(0.02)
    assert events == ["PauseRenderEvent", "ResumeRenderEvent"]


def test_at_the_end_time_goes_on_and_the_tumour_turns_grey(guard, application, clock):
    guard.seek(75.3)
    spin_until(guard, at(75.3))
    assert tumor_color(application) != GREY
    guard.play()
    status = spin_until(guard, lambda now: not now.has_session)
    assert status.session.endswith("ended")
    clock.ns += 61_000_000  # the case says 60 ms
    status = guard.spin(0.0)
    assert status.state is MarginState.UNKNOWN
    assert status.banner.startswith("UNKNOWN: not to be trusted, data 0.1 s old")
    assert status.reasons == "stale"
    assert tumor_color(application) == GREY
    guard.play()  # from the beginning
    spin_until(guard, lambda now: now.is_playing and now.position_s < 5.0)


def test_a_paused_recording_does_not_age_but_one_that_plays_and_stops_delivering_does(
    guard, application, clock
):
    guard.seek(45.9)
    spin_until(guard, at(45.9))
    clock.ns += 10_000_000_000
    guard.spin(0.0)
    assert tumor_color(application) == RED

    with (
        guard.session.thread.run.between_steps()
    ):  # the worker cannot step: it has stopped delivering
        guard.play()
        clock.ns += 61_000_000
        status = guard.spin(0.0)
        assert status.state is MarginState.UNKNOWN
        assert tumor_color(application) == GREY
        assert not line(application).GetVisibility()
        assert "stale" in status.trackers
    spin_until(guard, lambda now: now.state is MarginState.POSITIVE)


def test_margins_are_changed_whole_or_not_at_all_and_stay_through_a_seek(guard, application):
    guard.seek(5.0)
    assert spin_until(guard, at(5.0)).state is MarginState.NEGATIVE
    with pytest.raises(MarginGuardError, match="warn_mm is 5; expected more than stop_mm 9"):
        guard.set_margins(9.0, 5.0)
    assert guard.margins().stop_mm == 1.0
    guard.set_margins(2.0, 150.0)
    guard.step()
    spin_until(guard, lambda now: now.state is MarginState.WARNING)
    guard.seek(6.0)
    assert spin_until(guard, at(6.0)).state is MarginState.WARNING
    assert guard.margins().warn_mm == 150.0


def test_a_model_becomes_the_tumour(guard, application):
    """A ball around the tool's tip: the tool is in it, where it was clear before."""
    from vtkmodules.vtkFiltersSources import vtkSphereSource

    guard.seek(5.0)
    spin_until(guard, at(5.0))
    ball = vtkSphereSource()
    ball.SetRadius(8.0)
    ball.SetThetaResolution(24)
    ball.SetPhiResolution(24)
    tip = application.scene.GetFirstNodeByName("CauteryTipToCautery")
    ball.SetCenter(slicer.util.arrayFromTransformMatrix(tip, toWorld=True)[:3, 3])
    ball.Update()
    model = application.scene.AddNewNodeByClass("vtkMRMLModelNode", "Ball")
    model.SetAndObservePolyData(ball.GetOutput())
    with pytest.raises(MarginGuardError, match="tumour: no node is selected"):
        guard.set_tumor(None)
    guard.set_tumor(model)
    guard.step()
    status = spin_until(guard, lambda now: "sha256" in now.message)
    guard.step()
    status = spin_until(guard, lambda now: now.state is not MarginState.UNKNOWN)
    assert status.state is MarginState.POSITIVE
    shown = application.scene.GetFirstNodeByName("Tumor")
    bounds = np.reshape(shown.GetPolyData().GetBounds(), (3, 2))
    assert bounds[:, 1] - bounds[:, 0] == pytest.approx(16.0, abs=0.3)
    # Its latched hold is the operator's to end.
    assert "latched" in status.reasons
    guard.rearm()
    before = status.position_s
    guard.step()
    status = spin_until(guard, lambda now: now.position_s > before)
    assert "latched" not in status.reasons


def test_a_rearm_needs_a_margin_that_is_known(guard):
    guard.seek(22.3)
    spin_until(guard, at(22.3))
    with pytest.raises(MarginGuardError, match="the displayed margin is UNKNOWN"):
        guard.rearm()


def test_a_rearm_is_for_what_was_seen_and_not_for_a_fault_that_came_since(guard):
    """The dropout at 22.3 s comes and goes between two ticks of the panel's timer."""
    guard.seek(21.0)
    assert spin_until(guard, at(21.0)).state is not MarginState.UNKNOWN
    player = guard.session.replay().player
    begun_ns = player.time_ns
    player.step(150)  # through the dropout, and nobody looks
    pause = threading.Event()
    for _ in range(PATIENCE_SPINS):
        if player.time_ns - begun_ns > 2_900_000_000:
            break
        pause.wait(0.005)
    assert guard.session.thread.fault_seq > 1
    with pytest.raises(MarginGuardError, match="a fault came after the displayed step 1"):
        guard.rearm()
    status = spin_until(guard, at(24.0))
    assert status.state is not MarginState.UNKNOWN
    assert "latched" in status.reasons
    guard.rearm()
    guard.step()
    spin_until(guard, lambda now: "latched" not in now.reasons)


def test_a_rearm_is_not_for_a_margin_that_was_changed_since(guard):
    guard.seek(5.0)
    spin_until(guard, at(5.0))
    guard.set_margins(2.0, 9.0)
    with pytest.raises(MarginGuardError, match="the last change is not displayed yet"):
        guard.rearm()


def first_display(node):
    return node.GetDisplayNode()


@pytest.mark.parametrize(
    ("name", "of"),
    [
        ("Tumor", None),
        ("Tumor", first_display),
        ("MarginStatus", None),
        ("NeedleToReference", None),
    ],
    ids=["tumour", "its display", "banner", "transform"],
)
def test_a_node_that_the_user_deletes_turns_the_panel_grey_until_all_is_shown_anew(
    guard, application, name, of
):
    guard.seek(5.0)
    assert spin_until(guard, at(5.0)).state is MarginState.NEGATIVE
    node = application.scene.GetFirstNodeByName(name)
    application.scene.RemoveNode(node if of is None else of(node))
    status = guard.spin(0.0)
    assert status.state is MarginState.UNKNOWN
    assert status.banner.startswith("UNKNOWN: nothing is displayed, ")
    assert name in status.message
    for left in ("Tumor", "MarginStatus", "ClosestPoints"):
        assert application.scene.GetFirstNodeByName(left) is None
    with pytest.raises(MarginGuardError, match="UNKNOWN"):
        guard.rearm()
    guard.step()
    spin_until(guard, lambda now: now.state is MarginState.NEGATIVE)
    assert tumor_color(application) == MarginState.NEGATIVE.color


def test_a_colour_that_is_no_states_is_not_taken_for_one(guard, application):
    guard.seek(5.0)
    spin_until(guard, at(5.0))
    application.scene.GetFirstNodeByName("Tumor").GetDisplayNode().SetColor(0.2, 0.4, 0.9)
    assert guard.session.readout()[0] is MarginState.UNKNOWN
    assert guard.spin(0.0).state is MarginState.NEGATIVE  # and is overwritten


def test_a_tumour_for_a_session_that_is_gone_is_not_told_as_set(guard, application, monkeypatch):
    monkeypatch.setattr(OperatorCommands, "set_tumor", lambda *_: "the one that was set")
    points = application.scene.AddNewNodeByClass("vtkMRMLMarkupsFiducialNode", "Around")
    for point in 10.0 * np.vstack([np.eye(3), -np.eye(3)]):
        points.AddControlPoint(point.tolist())
    guard.set_tumor(points)
    guard.seek(5.0)
    status = spin_until(guard, lambda now: now.message and "..." not in now.message)
    assert "another session has started meanwhile" in status.message


def test_registrations_from_the_case_and_from_landmarks_agree(guard, application, opened):
    guard.register_case(CASE)
    status = spin_until(guard, lambda now: now.can_accept)
    assert status.registration.startswith("paired points, 8 points, FRE 0.")
    known = opened.setup.robot.registration.transform
    assert guard.candidate.transform.translation_mm == pytest.approx(known.translation_mm)
    guard.accept_registration()
    with pytest.raises(MarginGuardError, match="no registration to accept"):
        guard.accept_registration()

    base_mm = np.array([[0, 0, 0], [90, 0, 0], [0, 80, 0], [0, 0, 70], [60, 60, 10.0]])
    lists = {
        "in_reference": known.apply(base_mm),
        "in_base": base_mm,
    }
    nodes = []
    for name, points_mm in lists.items():
        node = application.scene.AddNewNodeByClass("vtkMRMLMarkupsFiducialNode", name)
        for point in points_mm:
            node.AddControlPoint(point.tolist())
        nodes.append(node)
    with pytest.raises(MarginGuardError, match="landmarks: a list is missing"):
        guard.register_landmarks(nodes[0], None)
    guard.register_landmarks(*nodes)
    assert guard.candidate.accepted, guard.candidate.reason
    assert guard.candidate.transform.matrix == pytest.approx(known.matrix, abs=1e-6)


def test_views_opacity_and_the_patients_place(guard, application):
    with pytest.raises(MarginGuardError, match="no 3D view"):
        guard.look(Preset.ANTERIOR)
    camera = application.scene.AddNewNodeByClass("vtkMRMLCameraNode")
    guard.look(Preset.SUPERIOR)
    towards = np.array(camera.GetPosition()) - np.array(camera.GetFocalPoint())
    assert towards / np.linalg.norm(towards) == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)

    guard.seek(5.0)
    spin_until(guard, at(5.0))
    guard.follow_tool(True)
    tip = application.scene.GetFirstNodeByName("CauteryTipToCautery")
    here = slicer.util.arrayFromTransformMatrix(tip, toWorld=True)[:3, 3]
    assert camera.GetFocalPoint() == pytest.approx(here, abs=1e-6)
    guard.seek(45.9)
    spin_until(guard, at(45.9))
    there = slicer.util.arrayFromTransformMatrix(tip, toWorld=True)[:3, 3]
    assert np.linalg.norm(there - here) > 10.0
    assert camera.GetFocalPoint() == pytest.approx(there, abs=1e-6)
    guard.look(Preset.LEFT)
    assert not guard.is_following

    guard.set_opacity(0.9)
    tumor = application.scene.GetFirstNodeByName("Tumor")
    assert tumor.GetDisplayNode().GetOpacity() == 0.9
    patient = application.scene.AddNewNodeByClass("vtkMRMLLinearTransformNode")
    slicer.util.updateTransformMatrixFromArray(
        patient, np.block([[np.eye(3), np.array([[100.0], [0], [0]])], [0, 0, 0, 1]])
    )
    guard.set_patient_to_ras(patient)
    moved = slicer.util.arrayFromTransformMatrix(tip, toWorld=True)[:3, 3]
    assert moved - there == pytest.approx([100.0, 0.0, 0.0], abs=1e-9)
    assert spin_until(guard, at(45.9)).state is MarginState.POSITIVE  # a display matter only
    with pytest.raises(
        MarginGuardError, match="CauteryToReference is below ReferenceToRas; expected"
    ):
        guard.set_patient_to_ras(application.scene.GetFirstNodeByName("CauteryToReference"))
    guard.set_patient_to_ras(None)
    assert slicer.util.arrayFromTransformMatrix(tip, toWorld=True)[:3, 3] == pytest.approx(there)


def test_what_cannot_be_is_refused_and_what_fails_later_is_one_line(guard, application, tmp_path):
    for command, message in (
        (lambda: guard.seek(76.0), "expected 0 to 75.4 s"),
        (lambda: guard.set_rate(-1.0), "rate of a replay is -1.0"),
        (lambda: guard.load_case(tmp_path / "none"), "no such folder"),
    ):
        with pytest.raises(MarginGuardError, match=message):
            command()
    guard.register_case(tmp_path)
    status = spin_until(guard, lambda now: "..." not in now.message and now.message)
    assert status.message.startswith("registering: ")
    assert "\n" not in status.message


def names_in(scene):
    """How often each name is that of a node which is seen or moves something."""
    nodes = [scene.GetNthNode(place) for place in range(scene.GetNumberOfNodes())]
    return Counter(node.GetName() for node in nodes if node.IsA("vtkMRMLTransformableNode"))


def test_a_scene_that_was_saved_and_opened_again_is_gone_on_with(
    guard, application, clock, tmp_path
):
    guard.seek(1.0)
    spin_until(guard, at(1.0))
    scene = application.scene
    before = names_in(scene)
    save_scene(scene, tmp_path / "case.mrb")
    guard.close()
    load_scene(scene, tmp_path / "case.mrb")
    tumor = scene.GetFirstNodeByName("Tumor")
    again = PanelLogic(scene, application.logic, clock)
    again.load_case(CASE)
    spin_until(again, at(0.0))
    assert before["Tumor"] == before["CauteryToReference"] == 1
    assert names_in(scene) == before
    assert scene.GetFirstNodeByName("Tumor") is tumor
    again.close()


def test_nothing_is_left_in_the_scene(guard, application):
    before = {"Selection", "Interaction", "SubjectHierarchy"}
    guard.close()
    scene = application.scene
    names = {scene.GetNthNode(place).GetName() for place in range(scene.GetNumberOfNodes())}
    assert names <= before


def test_a_run_that_fails_says_so_and_what_it_showed_ages(clock):
    class FailingRun:
        """TEST DOUBLE: a session that breaks."""

        commands = None

        def steps(self):
            raise ValueError("broken\ninside")
            yield

        def stop(self):
            pass

        @contextmanager
        def between_steps(self):
            yield None

        def pace(self):
            return 0.0

    thread = StepThread(FailingRun(), clock, one_line)
    thread.stop()
    assert thread.is_over
    assert thread.failure == "unexpected ValueError: broken inside (the log has all of it)"
    assert thread.newest(0.0) is None
