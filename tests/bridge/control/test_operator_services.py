"""A tumour or registration set by another process is applied as a whole or refused."""

import math
import threading
from contextlib import contextmanager
from dataclasses import replace

import pytest
from marginguard_msgs.srv import SetStructure

from app.bridge.control.operator_requests import OperatorList, OperatorRequests
from app.bridge.control.operator_services import OperatorServices
from app.case import open_case
from app.geometry import SurfaceMesh
from app.runtime import OperatorCommands, PassiveOutput, StepHolds, content_of
from app.session import Session, setup_from_case
from tests.bridge.conftest import DEADLINE_S
from tests.bridge.service_calls import CALLER, call_of, pairs, structure, switch, tumor

pytestmark = pytest.mark.slow


class RecordingOutput(PassiveOutput):
    """Test double of a publisher: the contents that it prepared and the ones it switched to."""

    def __init__(self, stepping):
        self.contents = []
        self.prepared = []
        self.locked_while_preparing = []
        self.revoked = 0
        self._stepping = stepping

    def publish(self, step, timing):
        return True

    def prepare(self, content):
        self.prepared.append(content)
        self.locked_while_preparing.append(self._stepping.locked())
        return self.contents.append

    def revoke(self):
        self.revoked += 1


@pytest.fixture(scope="module")
def case(project_root):
    return open_case(project_root / "data" / "recorded_case")


@pytest.fixture(scope="module")
def setup(case):
    return setup_from_case(case, tip_only=True)


@pytest.fixture
def session(setup):
    return Session(setup)


class StepLock:
    """Test double of the lock that is held during a step; sets ``requested`` before it waits."""

    def __init__(self):
        self._lock = threading.Lock()
        self.requested = threading.Event()

    def __enter__(self):
        self.requested.set()
        self._lock.acquire()

    def __exit__(self, *_):
        self._lock.release()

    def locked(self):
        return self._lock.locked()


@pytest.fixture
def stepping():
    return StepLock()


@pytest.fixture
def output(stepping):
    return RecordingOutput(stepping)


@pytest.fixture
def allowed():
    """Nodes that may send requests; None for every node."""
    return


@pytest.fixture
def commands(ros, session, output, case, setup, stepping, allowed):
    """Operator commands of a session of the recorded case, served by the node."""

    @contextmanager
    def between_steps():
        with stepping:
            yield session

    content = replace(content_of(case, setup, tip_only=True), tool=case.tool_mesh())
    made = OperatorCommands(between_steps, content, (output,), holds=StepHolds())
    OperatorServices(ros, made, OperatorRequests(ros, made.requests, OperatorList(ros, allowed)))
    return made


def test_valid_tumor_is_used_and_invalid_ones_change_nothing(
    commands, session, setup, output, start_receiver
):
    before = commands.content
    sent = tumor(0.03, "nowhere"), tumor(0.03, is_open=True), tumor(math.nan), tumor(0.03)
    caller = start_receiver(*map(call_of, sent), script=CALLER)
    elsewhere, is_open, nan = caller.take(3)
    for reply in (elsewhere, is_open, nan):
        assert (reply["success"], reply["model_id"]) == (False, "")
    assert "'nowhere'" in elsewhere["message"]
    assert "finite" in nan["message"]
    assert is_open["message"]
    (applied,) = caller.take(1)
    assert (applied["success"], applied["message"]) == (True, "")
    assert applied["model_id"] == commands.content.model_id != before.model_id
    assert len(output.contents) == 1
    content = output.contents[0]
    assert content.tumor.vertices_mm.max() == pytest.approx(30.0)
    assert session.setup.frame_from_tumor.translation_mm.tolist() == [1.0, 0.0, 0.0]
    edges = {(edge.target, edge.source): edge for edge in content.static_edges}
    assert edges["needle", "tumor"] is session.setup.frame_from_tumor
    assert len(edges) == len(setup.static_edges)
    assert session.setup.proximity is not setup.proximity


@pytest.mark.parametrize(
    "wrong",
    [
        {
            "role: is 'organ'; expected one of target, forbidden": structure(role="organ"),
            "the surface has 0 triangles": SetStructure.Request(name="vessel", role="target"),
            "the mesh of structure 'vessel' is not closed": structure(is_open=True),
            "finite": structure(math.nan),
            "'tumor': is the tumour": structure(name="tumor"),
        },
        {
            "frame name ''": structure(name=""),
            "frame name 'a b'": structure(frame="a b"),
            "stop_mm": structure(stop_distance=0.5),
            "uncertainty of structure 'vessel': is nan": structure(sigma=math.nan),
            "'wall': is not guarded; expected one of": switch(False, "x", "wall"),
        },
    ],
    ids=["surface", "values"],
)
def test_wrong_structure_is_refused_in_one_line(commands, output, start_receiver, wrong):
    replies = start_receiver(*map(call_of, wrong.values()), script=CALLER).take(len(wrong))
    for text, reply in zip(wrong, replies, strict=True):
        assert (reply["success"], reply["setup_id"]) == (False, "")
        assert text in reply["message"]
        assert "\n" not in reply["message"]
    assert output.contents == []


def test_structure_is_guarded_in_its_units(commands, session, start_receiver):
    before = commands.content.setup_id
    (reply,) = start_receiver(call_of(structure(sigma=0.0004)), script=CALLER).take(1)
    assert (reply["success"], reply["message"]) == (True, "")
    assert reply["setup_id"] == commands.content.setup_id != before
    (shown,), (guarded,) = commands.content.structures, session.setup.structures
    assert shown.surface.vertices_mm.max() == pytest.approx(30.0)
    for each in (shown, guarded):
        assert (each.name, each.role) == ("vessel", "forbidden")
        distances_mm = each.stop_mm, each.warn_mm, each.sigma_mm
        assert distances_mm == pytest.approx((1.0, 3.0, 0.4))
    assert guarded.frame_from_structure.translation_mm.tolist() == [1.0, 0.0, 0.0]


@pytest.mark.parametrize("allowed", [["/console"]])
def test_only_operators_change_structures(commands, session, output, start_receiver):
    listed = []
    commands.requests.listen(listed.append)
    sent = structure(), switch(False, "x", "wall")
    replies = start_receiver(*map(call_of, sent), script=CALLER).take(2)
    for reply in replies:
        assert (reply["success"], reply["setup_id"]) == (False, "")
        assert "has a client and is no operator; expected clients of /console" in reply["message"]
    assert [(each.kind, each.origin, each.accepted) for each in listed] == [
        ("set_structure", "ROS", False),
        ("switch_structure", "ROS", False),
    ]
    assert output.contents == [] and session.setup.structures == ()


def test_structure_is_switched_off_with_a_reason_and_on(commands, session, output, start_receiver):
    sent = structure(), switch(False), switch(False, "resected"), switch(True)
    added, refused, off, on = start_receiver(*map(call_of, sent), script=CALLER).take(4)
    assert not refused["success"] and "reason has 0 characters" in refused["message"]
    assert [each["success"] for each in (added, off, on)] == [True, True, True]
    assert added["setup_id"] == on["setup_id"] != off["setup_id"]
    assert [len(each.structures) for each in output.contents] == [1, 0, 1]
    assert session.hold_causes == ("a change that loosened the session was undone",)


def test_session_continues_while_a_new_tumor_is_prepared(commands, output, case):
    other = case.tumor_mesh()
    other = SurfaceMesh(other.frame, other.vertices_mm * 0.9, other.faces)
    commands.set_tumor(commands.setup.frame_from_tumor, other, origin="a test")
    assert output.locked_while_preparing == [False]
    assert output.prepared[0].tumor is output.contents[0].tumor is other
    assert output.revoked == 1


def test_node_stays_responsive_while_a_change_waits_for_a_step(
    ros, commands, stepping, start_receiver
):
    called = threading.Event()
    with stepping:
        stepping.requested.clear()
        caller = start_receiver(call_of(pairs(0.00001)), script=CALLER)
        assert stepping.requested.wait(DEADLINE_S)
        ros.call_soon(called.set)
        assert called.wait(DEADLINE_S)
    assert caller.take(1)[0]["success"]


def test_accepted_registration_is_used_and_refused_one_changes_nothing(
    commands, session, setup, output, start_receiver
):
    caller = start_receiver(call_of(pairs(0.05)), call_of(pairs(0.00001)), script=CALLER)
    bad, good = caller.take(2)
    assert (bad["success"], bad["registration_id"]) == (False, "")
    assert "not accepted" in bad["message"]
    assert (good["success"], good["message"]) == (True, "")
    assert good["transform"]["translation"]["x"] == pytest.approx(0.5, abs=1e-3)
    assert 0.0 < good["fre"] < 2e-5
    assert good["registration_id"] == commands.content.registration_id
    assert len(output.contents) == 1
    registration = session.setup.robot.registration
    assert registration.transform.translation_mm[0] == pytest.approx(500.0, abs=1.0)
    assert output.contents[0].registration is registration
    assert registration.transform in output.contents[0].static_edges
    assert len(output.contents[0].static_edges) == len(setup.static_edges)
