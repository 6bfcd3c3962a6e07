"""Services and parameters for the operators of a live node."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from app.bridge.control import MarginParameterServer, OperatorServices
from app.bridge.control.margin_parameters import OVER_ROS
from app.bridge.control.operator_requests import OperatorRequests
from app.bridge.control.operators import OperatorList
from app.bridge.control.recording_service import RecordingService
from app.bridge.displays.display_output import CommandService
from app.bridge.live.rearming import RearmService
from app.bridge.node import RosNode
from app.case import LiveCase
from app.fixture import MarginParameters
from app.runtime import LiveRun, RequestKind


@contextmanager
def served_operators(
    ros: RosNode, run: LiveRun, config: LiveCase, displays: Sequence[str], instance_id: str
) -> Iterator[None]:
    """Serve ``~/rearm``, ``~/set_tumor``, ``~/register``, ``~/record`` and margins as parameters.

    And ``~/command`` for displays; the nodes ``displays`` may send it besides the operators of
    ``config``. All of them change the session through the commands of ``run``.
    """
    commands = run.commands
    allowed = None if config.operators is None else (*config.operators, *displays)
    requests = OperatorRequests(ros, commands.requests, OperatorList(ros, allowed))

    def set_margins(requested: MarginParameters, origin: str) -> None:
        if origin == OVER_ROS:
            services = ("~/set_parameters", "~/set_parameters_atomically")
            with requests.refusals(RequestKind.MARGINS):
                requests.check_margins(commands.content.margins, requested, *services)
        commands.set_margins(requested, origin=origin)

    def refused(reason: str, origin: str) -> None:
        commands.requests.refused(RequestKind.MARGINS, origin, reason)

    RearmService(ros, commands, requests)
    server = MarginParameterServer(ros, commands.content.margins, set_margins, refused)
    OperatorServices(ros, commands, requests)
    RecordingService(ros, commands, requests)
    CommandService(ros, commands, requests, instance_id)

    def keep_margins(stop_mm: float, warn_mm: float, origin: str) -> None:
        server.set(stop_mm=stop_mm, warn_mm=warn_mm, origin=origin)

    commands.keep_margins = keep_margins
    try:
        yield
    finally:
        server.close()
