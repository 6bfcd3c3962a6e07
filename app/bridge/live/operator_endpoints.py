"""What serves the operators of a live node: services, parameters, request log and audit log."""

import os
import re
import socket
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from app.bridge.control import MarginParameterServer, OperatorServices
from app.bridge.control.margin_parameters import OVER_ROS
from app.bridge.control.operator_requests import OperatorRequests
from app.bridge.control.operators import OperatorList
from app.bridge.control.recording_service import RecordingService
from app.bridge.displays.display_output import CommandService
from app.bridge.live.rearming import RearmService
from app.bridge.node import RosNode
from app.bridge.publishing.constraint_stream import ConstraintStream
from app.case import LiveCase
from app.files.state_folder import state_folder
from app.fixture import MarginParameters
from app.geometry import InputError
from app.runtime import AuditLog, CaseRecorder, LiveRun, RequestKind


def audit_file(ros: RosNode) -> Path:
    """Default audit log of a live node, below the state folder, by host, domain and namespace.

    Raises `InputError` for a user without a home folder.
    """
    domain, namespace = ros.node.context.get_domain_id(), ros.node.get_namespace()
    parts = (socket.gethostname(), f"domain{domain}", namespace.strip("/"))
    name = "-".join(re.sub(r"[^A-Za-z0-9.]+", "_", part)[:60] for part in parts if part)
    return state_folder() / "audit" / f"{name}.jsonl"


@contextmanager
def case_recorder(config: LiveCase, namespace: str, cases: Path | None) -> Iterator[CaseRecorder]:
    """Records the session of ``config`` below ``cases``, by default below the state folder.

    A running recording is finished at the end of the context.
    """
    case = config.case
    recorder = CaseRecorder(
        case.folder / case.manifest.file,
        cases or state_folder() / "cases",
        title=case.manifest.name,
        package_dirs=case.package_dirs,
        namespace=namespace,
    )
    try:
        yield recorder
    finally:
        with suppress(InputError):  # it has been listed with the requests
            recorder.close()


@contextmanager
def audit_log(ros: RosNode, constraints: ConstraintStream, path: Path) -> Iterator[AuditLog]:
    """The audit log of a live node; within the context its thread writes."""
    about = {
        "node": ros.node.get_fully_qualified_name(),
        "pid": os.getpid(),
        "instance_id": constraints.instance_id,
    }
    log = AuditLog(path, about, time.time_ns, ros.node.get_logger().error)
    try:
        ros.node.get_logger().info(f"audit log: {log.path}")
        yield log
    finally:
        log.close()


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

    def keep_margins(stop_mm: float, warn_mm: float, origin: str) -> None:
        server.set(stop_mm=stop_mm, warn_mm=warn_mm, origin=origin)

    RearmService(ros, commands, requests)
    server = MarginParameterServer(ros, commands.content.margins, set_margins, refused)
    OperatorServices(ros, commands, requests)
    RecordingService(ros, commands, requests)
    CommandService(ros, commands, requests, instance_id)
    commands.keep_margins = keep_margins
    try:
        yield
    finally:
        server.close()
