"""Another process gives a new tumour, a new registration: whole, or not at all and said why."""

import threading
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from app.bridge.control import OperatorServices, SessionChanges, session_changes
from app.bridge.publishing.prepared_shapes import PreparedShapes
from app.case import open_case
from app.geometry import SurfaceMesh
from app.session import Session, setup_from_case
from tests.bridge.conftest import DEADLINE_S

CALLER = Path(__file__).resolve().parent / "operator_caller.py"


class Shown:
    """What a publisher is told to show."""

    def __init__(self):
        self.scenes = []
        self.shapes = []

    def use(self, scene, shapes=None):
        self.scenes.append(scene)
        self.shapes.append(shapes)


@pytest.fixture(scope="module")
def case(project_root):
    return open_case(project_root / "data" / "recorded_case")


@pytest.fixture(scope="module")
def setup(case):
    return setup_from_case(case, tip_only=True)


@pytest.fixture
def session(setup):
    return Session(setup)


@pytest.fixture
def shown():
    return Shown()


class StepLock:
    """Test double of the lock that is held while a step is taken; tells when somebody wants it."""

    def __init__(self):
        self._lock = threading.Lock()
        self.wanted = threading.Event()

    def __enter__(self):
        self.wanted.set()
        self._lock.acquire()

    def __exit__(self, *_):
        self._lock.release()

    def locked(self):
        return self._lock.locked()


@pytest.fixture
def stepping():
    return StepLock()


@pytest.fixture
def changes(ros, session, shown, scene, case, setup, stepping):
    """On a session of the recorded case, with the node serving."""

    @contextmanager
    def between_steps():
        with stepping:
            yield session

    real = replace(
        scene,
        tumor=case.tumor_mesh(),
        static_edges=setup.static_edges,
        registration=setup.robot.registration,
    )
    made = SessionChanges(between_steps, shown, real)
    OperatorServices(ros, made)
    return made


def test_a_sound_tumor_is_taken_and_others_leave_what_was(
    changes, session, setup, shown, start_receiver
):
    before = changes.scene
    elsewhere, is_open = ("0.03", "nowhere", "sound"), ("0.03", "needle", "open")
    nan, good = ("nan", "needle", "sound"), ("0.03", "needle", "sound")
    caller = start_receiver(*elsewhere, *is_open, *nan, *good, script=CALLER)
    elsewhere, is_open, nan = caller.take(3)
    for reply in (elsewhere, is_open, nan):
        assert (reply["success"], reply["id"]) == (False, "")
    assert "'nowhere'" in elsewhere["message"]
    assert "finite" in nan["message"]
    assert is_open["message"]
    (taken,) = caller.take(1)
    assert (taken["success"], taken["message"]) == (True, "")
    assert taken["id"] == changes.scene.model_id != before.model_id
    assert len(shown.scenes) == 1
    scene = shown.scenes[0]
    assert scene.tumor.vertices_mm.max() == pytest.approx(30.0)
    assert session.setup.frame_from_tumor.translation_mm.tolist() == [1.0, 0.0, 0.0]
    edges = {(edge.target, edge.source): edge for edge in scene.static_edges}
    assert edges["needle", "tumor"] is session.setup.frame_from_tumor
    assert len(edges) == len(setup.static_edges)
    assert session.setup.proximity is not setup.proximity


def test_the_session_goes_on_while_all_of_a_new_tumor_is_made(
    changes, shown, case, stepping, monkeypatch
):
    held_up = []

    class Watched(PreparedShapes):
        def __init__(self, scene):
            held_up.append(stepping.locked())
            super().__init__(scene)

    monkeypatch.setattr(session_changes, "PreparedShapes", Watched)
    other = case.tumor_mesh()
    other = SurfaceMesh(other.frame, other.vertices_mm * 0.9, other.faces)
    changes.set_tumor(changes.setup.frame_from_tumor, other)
    assert held_up == [False]
    assert shown.shapes[0].are_of(shown.scenes[0])
    assert shown.scenes[0].tumor is other


def test_the_node_hears_others_while_a_change_waits_for_a_step(
    ros, changes, stepping, start_receiver
):
    heard = threading.Event()
    with stepping:
        stepping.wanted.clear()
        caller = start_receiver("register", "0.00001", script=CALLER)
        assert stepping.wanted.wait(DEADLINE_S)
        ros.call_soon(heard.set)
        assert heard.wait(DEADLINE_S)
    assert caller.take(1)[0]["success"]


def test_a_good_registration_is_used_and_a_bad_one_leaves_what_was(
    changes, session, setup, shown, start_receiver
):
    caller = start_receiver("register", "0.05", "0.00001", script=CALLER)
    bad, good = caller.take(2)
    assert (bad["success"], bad["id"]) == (False, "")
    assert "refused" in bad["message"]
    assert (good["success"], good["message"]) == (True, "")
    assert good["x"] == pytest.approx(0.5, abs=1e-3)
    assert 0.0 < good["fre"] < 2e-5
    assert good["id"] == changes.scene.registration_id
    assert len(shown.scenes) == 1
    registration = session.setup.robot.registration
    assert registration.transform.translation_mm[0] == pytest.approx(500.0, abs=1.0)
    assert shown.scenes[0].registration is registration
    assert registration.transform in shown.scenes[0].static_edges
    assert len(shown.scenes[0].static_edges) == len(setup.static_edges)
