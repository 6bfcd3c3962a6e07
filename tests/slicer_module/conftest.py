"""The ROS2 module in a scene beside a peer process with plain rclpy, and the panel MarginGuard."""

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tests.bridge.processes import Child
from tests.manual_clock import ManualClock
from tests.ros_domain import environment_of, reserved_domain
from tests.slicer_module.ros2_values import URDF
from tests.waiting import DEADLINE_S, wait_until

PEER = Path(__file__).resolve().parent / "ros2_peer.py"


class Peer(Child):
    """Peer process; ``peer("publish", topic=..., ...)`` runs a command and returns its result."""

    def __call__(self, do: str, **arguments: Any) -> Any:
        self.begin(do, **arguments)
        return self.result()

    def begin(self, do: str, **arguments: Any) -> None:
        """Send the command ``do`` without waiting for its result."""
        self.send(json.dumps({"do": do, **arguments}))

    def result(self) -> Any:
        """Wait for the result of the last command; fail the test if the command failed."""
        reply = json.loads(self.line())
        return self.fail(reply["failed"]) if "failed" in reply else reply["done"]


@pytest.fixture(scope="session")
def ros_domain() -> Iterator[int]:
    with reserved_domain() as domain:
        yield domain


@pytest.fixture(scope="session")
def peer(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Peer]:
    log = tmp_path_factory.mktemp("peer") / "peer.log"
    process = Peer([PEER], log, environment_of(ros_domain))
    assert process("set_parameter", name="robot_description", value=URDF, of="robot")
    yield process
    process.close()


@pytest.fixture
def domain(ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> int:
    """ROS domain of `peer`; set in the environment. No call of a client ends by a timeout."""
    for name in ("service_nodes._TIMEOUT_S", "action_client._CANCEL_TIMEOUT_S"):
        monkeypatch.setattr(f"ROS2Lib.{name}", DEADLINE_S)
    monkeypatch.setattr("ROS2Lib.robot_kinematics._TRANSPORT_S", DEADLINE_S)
    monkeypatch.setattr("app.bridge.node._JOIN_TIMEOUT_S", DEADLINE_S)
    for name, value in environment_of(ros_domain).items():
        monkeypatch.setenv(name, value)
    return ros_domain


@pytest.fixture
def make_api(domain: int) -> Iterator[Callable[[], Any]]:
    """``make_api()``: logic of the ROS2 module for a new scene; closed after the test."""
    from slicer import vtkMRMLScene

    from app.scene import SceneApplication
    from ROS2Lib.logic import Ros2Api

    made = []

    def make() -> Any:
        application = SceneApplication(vtkMRMLScene())
        made.append((application, Ros2Api(application.scene)))
        return made[-1][1]

    yield make
    for _, api in made:
        api.Close()


@pytest.fixture(scope="session")
def session_logic() -> Iterator[Any]:
    from slicer import vtkMRMLScene

    from app.scene import SceneApplication
    from ROS2Lib.logic import Ros2Api

    application = SceneApplication(vtkMRMLScene())
    made = Ros2Api(application.scene)
    yield made
    made.Close()


@pytest.fixture
def logic(session_logic: Any, domain: int) -> Iterator[Any]:
    """Logic of the module; its nodes are in the ROS domain of `peer`.

    What a test adds to the scene or to the default node is removed after it.
    """
    scene = session_logic.scene
    session_logic.GetDefaultROS2Node()
    before = nodes_of(scene)
    yield session_logic
    for each in nodes_of(scene):
        if each not in before and each.GetSingletonTag() is None and scene.IsNodePresent(each):
            scene.RemoveNode(each)
    session_logic.GetDefaultROS2Node().buffer.clear()


def nodes_of(scene: Any) -> list[Any]:
    return [scene.GetNthNode(place) for place in range(scene.GetNumberOfNodes())]


@pytest.fixture
def node(logic: Any) -> Any:
    return logic.GetDefaultROS2Node()


@pytest.fixture
def hear(peer: Peer) -> Callable[..., None]:
    """``hear(publisher, count)``: the peer listens; wait until ``count`` subscribers are known."""

    def listen(publisher: Any, count: int = 1) -> None:
        peer("listen", topic=f"/{publisher.GetTopic().lstrip('/')}", type=publisher.GetROSType())
        ros = publisher.GetNodeReference("node").ros
        assert ros.wait_for_subscribers(publisher._publisher.topic, count, DEADLINE_S)

    return listen


@pytest.fixture
def describe(peer: Peer) -> Iterator[Callable[[str], None]]:
    """``describe(text)`` sets the parameter of /robot_state_publisher, `URDF` in other tests."""

    def set_description(text: str) -> None:
        assert peer("set_parameter", name="robot_description", value=text, of="robot")

    yield set_description
    set_description(URDF)


@pytest.fixture
def spin_until(logic: Any) -> Callable[[Callable[[], Any]], None]:
    """Spin until ``ready()``."""
    return lambda ready: wait_until(ready, logic.Spin)


@pytest.fixture
def send_tf_until(logic: Any, peer: Peer) -> Callable[[list[Any], Callable[[], Any]], None]:
    """Let the peer send poses until ``ready()``: on a busy machine one can be stale at once."""

    def send(edges: list[Any], ready: Callable[[], Any]) -> None:
        wait_until(ready, lambda: (peer("send_tf", edges=edges), logic.Spin()))

    return send


@pytest.fixture
def application() -> Any:
    """Scene with the part of Slicer's application that markups need."""
    from slicer import vtkMRMLScene

    from app.scene import SceneApplication

    return SceneApplication(vtkMRMLScene())


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A cut of the recorded case as the panel opens it."""
    from tests.slicer_module.marginguard_module import cut_case, open_recorded

    return open_recorded(cut_case(tmp_path_factory.mktemp("cut") / "case"))


@pytest.fixture
def opens_at_once(recorded: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Every case that a panel opens is `recorded`, without a delay."""
    monkeypatch.setattr("MarginGuardLib.logic.prepare_recorded", lambda folder: recorded)
    return recorded


@pytest.fixture
def clock() -> Any:
    return ManualClock()


@pytest.fixture
def replayed(application: Any, opens_at_once: Any, clock: ManualClock) -> Iterator[Any]:
    """Logic of the panel with the case paused at its first frame; its clock stands still."""
    from tests.slicer_module.marginguard_module import CASE, PanelLogic, spin_until

    logic = PanelLogic(application.scene, application.logic, clock)
    logic.load_case(CASE)
    spin_until(logic, lambda now: now.position_s is not None and now.touch.can_start)
    yield logic
    logic.close()


@pytest.fixture
def unconnected(application: Any) -> Iterator[Any]:
    """Logic of the panel without a session."""
    from tests.slicer_module.marginguard_module import PanelLogic

    logic = PanelLogic(application.scene, application.logic)
    yield logic
    logic.close()


@pytest.fixture(scope="module")
def desktop() -> Iterator[ModuleType]:
    """The file of the module MarginGuard, loaded with TEST DOUBLES of desktop Slicer."""
    from tests.slicer_module.desktop import desktop_slicer
    from tests.slicer_module.marginguard_module import FOLDER

    assert str(FOLDER) in sys.path
    with desktop_slicer():
        import MarginGuard

        yield MarginGuard
    for name in ("MarginGuard", "MarginGuardLib.settings"):
        sys.modules.pop(name, None)


@pytest.fixture
def errors(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Texts of the error windows."""
    import slicer

    texts: list[str] = []
    monkeypatch.setattr(slicer.util, "errorDisplay", lambda text, **_: texts.append(text))
    return texts


@pytest.fixture
def panel(
    desktop: ModuleType, application: Any, monkeypatch: pytest.MonkeyPatch, errors: list[str]
) -> Iterator[Any]:
    """The panel MarginGuard; the tests call its spin."""
    with open_panel(desktop, application, monkeypatch) as widget:
        yield widget


@contextmanager
def open_panel(desktop: ModuleType, application: Any, patch: pytest.MonkeyPatch) -> Iterator[Any]:
    from tests.slicer_module.marginguard_module import FOLDER, in_slicer
    from tests.slicer_module.slicer_double import panel_parent

    in_slicer(patch, application)
    widget = desktop.MarginGuardWidget(panel_parent(FOLDER))
    widget.setup()
    widget._spinner.stop()
    yield widget
    widget.cleanup()
