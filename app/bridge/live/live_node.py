"""A live session on the ROS graph, as a pipeline: inputs, session, outputs, operators."""

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager
from pathlib import Path

from app.bridge.control.operator_requests import (
    OVER_ROS,
    MarginParameterServer,
    OperatorList,
    OperatorRequests,
)
from app.bridge.control.operator_services import OperatorServices, RearmService
from app.bridge.displays.display_output import CommandService
from app.bridge.environment import check_security
from app.bridge.live.inputs import Counts, LiveInputs, named_edges
from app.bridge.live.outputs import LiveOutputs, live_outputs
from app.bridge.live.single_instance import SingleInstance, single_instance
from app.bridge.node import RosNode
from app.bridge.publishing.serialized import PublishPolicy
from app.bridge.publishing.session_publisher import NODE_NAME, SessionPublisher
from app.case import LiveCase, TfSourceEntry
from app.fixture import MarginParameters, ProximityEngine, Reason
from app.runtime import (
    ComputeProcess,
    HoldKeeper,
    LiveRun,
    PreparedLive,
    RequestKind,
)
from app.session import (
    LiveSession,
    Session,
    SessionSetup,
    StepResult,
    guidance_parameters,
    limiter_parameters,
    load_replacement,
)

_LOAD_AFTER_S = 2.0
"""The process for new tumours starts so long after the session, when that has been loaded."""


@contextmanager
def live_node(
    prepared: PreparedLive,
    *,
    namespace: str,
    constraint_hz: float,
    ros: RosNode | None = None,
    audit: Path | None = None,
    cases: Path | None = None,
    displays: Sequence[str] = (),
) -> Iterator[LiveRun]:
    """Join the ROS graph: subscribe to the source of ``prepared``, serve the operator.

    With ``ros`` it uses that node, in the node's own thread; the owner of the node destroys its
    services and subscriptions. ``audit`` is the file of the audit log and ``cases`` the folder of
    the session's recordings, by default below the state folder. ``displays`` are nodes that may
    send commands, as the operators of the configuration. Raises `SecurityError`
    if the configuration requires ROS security that this process does not have.

    Begins on hold if the last run with this namespace or arm was on hold or did not end in an
    orderly way. Raises the errors of `single_instance`.
    """
    config = prepared.config
    limiter, guidance = limiter_parameters(config), guidance_parameters(config)
    counts: list[Counts] = []
    if config.needs_security:
        check_security(required=True)
    # The nodes of the tracker and of the robot publish their own data.
    measured = not isinstance(config.source, TfSourceEntry)
    with (
        single_instance(prepared, NODE_NAME, namespace, ros) as instance,
        SessionPublisher(
            prepared.content,
            namespace=namespace,
            heartbeat_hz=constraint_hz,
            policy=PublishPolicy(clock=False, measured=measured, robot=False),
            counts=lambda: {name: n for each in counts for name, n in each().items()},
            ros=ros,
        ) as publisher,
        ExitStack() as stack,
    ):
        opened, node = stack.enter_context, publisher.ros
        inputs = LiveInputs(prepared, publisher)
        node_outputs = opened(
            live_outputs(
                prepared,
                publisher,
                limiter=limiter,
                guidance=guidance,
                image_problem=inputs.image_problem,
                namespace=namespace,
                audit=audit,
                cases=cases,
                displays=displays,
            )
        )
        compute = opened(_compute_process(prepared.setup))
        run = _live_run(prepared, instance, publisher, inputs, node_outputs, compute)
        instance_id = publisher.constraints.instance_id
        opened(served_operators(node, run, config, displays, instance_id))
        try:
            counts += [
                run.live.left_out,
                *inputs.connect(run, node_outputs),
                lambda: {"callbacks that failed": node.failures},
                node_outputs.refused_twists,
            ]
            yield run
        finally:
            node_outputs.twists.close()
            inputs.close()


def _live_run(
    prepared: PreparedLive,
    instance: SingleInstance,
    publisher: SessionPublisher,
    inputs: LiveInputs,
    outputs: LiveOutputs,
    compute: ComputeProcess,
) -> LiveRun:
    """The session: steps through the samples of ``inputs`` and gives each step to ``outputs``."""
    config = prepared.config
    live = LiveSession(
        Session(prepared.setup, free_motion=True, skip_far=True),
        host_ns=_host_clock(config.stamps_of_host),
        stamps_of_host=config.stamps_of_host,
        edges=named_edges(config.source),
        playback=inputs.playback,
        outside=lambda: _joined(inputs.senders.outside(), instance.faults(publisher.ros)),
        source_problem=inputs.source_problem,
        activation=None if inputs.activation is None else inputs.activation.state,
    )
    return LiveRun(
        live,
        prepared.content,
        outputs.in_order,
        HoldKeeper(instance.state, lambda: publisher.constraints.ended),
        holds=publisher.constraints,
        requests=outputs.requests,
        compute=compute.call,
        recorder=outputs.recorder,
    )


def _compute_process(setup: SessionSetup) -> ComputeProcess:
    """The process that prepares a new tumour, loaded while the session waits to be re-armed."""
    process = ComputeProcess()
    if isinstance(setup.proximity, ProximityEngine):
        process.start_after(_LOAD_AFTER_S, load_replacement)
    return process


def _host_clock(stamps_of_host: bool) -> Callable[[], int]:
    """System time if stamps are of this host; otherwise a clock that NTP does not set back."""
    if stamps_of_host:
        return time.time_ns
    offset_ns = time.time_ns() - time.monotonic_ns()
    return lambda: offset_ns + time.monotonic_ns()


def _joined(first: Mapping[Reason, str], second: Mapping[Reason, str]) -> Mapping[Reason, str]:
    """Faults of both, with both texts where a reason is in both."""
    if not first or not second:
        return first or second
    texts = {
        reason: f"{first[reason]}; {second[reason]}" for reason in first.keys() & second.keys()
    }
    return {**first, **second, **texts}


@contextmanager
def served_operators(
    ros: RosNode, run: LiveRun, config: LiveCase, displays: Sequence[str], instance_id: str
) -> Iterator[None]:
    """Serve ``~/rearm``, `OperatorServices` and margins as parameters.

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
    CommandService(ros, commands, requests, instance_id)

    def keep_margins(stop_mm: float, warn_mm: float, origin: str) -> None:
        server.set(stop_mm=stop_mm, warn_mm=warn_mm, origin=origin)

    commands.keep_margins = keep_margins
    try:
        yield
    finally:
        server.close()


class LiveNodeLifecycle:
    """A `live_node` for `app.bridge.control.LifecycleRosNode`; each *configure* makes a new one.

    ``opened(ros)`` makes it. ``follow(steps)`` iterates over its steps while it is active, in a
    thread of its own. ``failed(error)`` is called there with an error that ended the steps: an
    active node that publishes nothing must not remain.
    """

    def __init__(
        self,
        opened: Callable[[RosNode], AbstractContextManager[LiveRun]],
        follow: Callable[[Iterator[StepResult]], None],
        failed: Callable[[Exception], None],
    ) -> None:
        self._opened = opened
        self._follow = follow
        self._failed = failed
        self._open = ExitStack()
        self._node: LiveRun | None = None
        self._thread: threading.Thread | None = None

    def configure(self, ros: RosNode) -> None:
        """Read all files, subscribe to the source, serve the operator."""
        self._node = self._open.enter_context(self._opened(ros))

    def activate(self) -> None:
        """Take steps. After an earlier *deactivate* the hold is latched until `~/rearm`."""
        if self._node is not None:
            self._node.live.resume()
            self._thread = threading.Thread(
                target=self._run, args=(self._node,), name="live steps", daemon=True
            )
            self._thread.start()

    def deactivate(self) -> None:
        """Stop stepping; the last constraint is on hold."""
        if self._node is not None and self._thread is not None:
            self._node.stop()
            self._thread.join()
            self._thread = None

    def clean_up(self) -> None:
        """Unsubscribe from the source and close everything that `configure` created."""
        self._node = None
        self._open.close()

    def _run(self, node: LiveRun) -> None:
        try:
            with closing(node.steps()) as steps:
                self._follow(steps)
        except Exception as error:  # the owner of the process decides
            self._failed(error)
