"""Service ``~/record``: an operator starts or stops the recording of a live session."""

from std_srvs.srv import SetBool

from app.bridge.calls.service_server import ServiceServer
from app.bridge.control.margin_parameters import OVER_ROS
from app.bridge.control.operator_requests import OperatorRequests
from app.bridge.node import RosNode
from app.runtime import OperatorCommands, RequestKind


class RecordingService:
    """Serves ``~/record`` until the node is closed: true starts, false stops.

    The reply has the folder of the recording, or why the request is refused. It runs in its own
    thread, because the recorder takes seconds to start.
    """

    def __init__(
        self, ros: RosNode, commands: OperatorCommands, requests: OperatorRequests
    ) -> None:
        self._commands = commands
        self._requests = requests
        ServiceServer(ros, SetBool, "~/record", self._serve, in_thread=True, check=self._check)

    def _check(self, request: SetBool.Request) -> None:
        with self._requests.refusals(RequestKind.RECORD):
            self._requests.check(RequestKind.RECORD, "~/record")

    def _serve(self, request: SetBool.Request, response: SetBool.Response) -> None:
        if request.data:
            status = self._commands.start_recording(origin=OVER_ROS)
        else:
            status = self._commands.stop_recording(origin=OVER_ROS)
        response.success, response.message = True, status.line
