"""The live session that the panel shows: a live node of its own, which the panel has started."""

import logging
from collections.abc import Callable, Iterator
from secrets import token_hex

from app.bridge import RosNode, prepare_environment
from app.bridge.displays import ApproachRequest, ExecutedPlan, LiveChild, SessionClient
from app.bridge.displays.remote_operator import PANEL_NODE
from app.bridge.publishing.session_publisher import NODE_NAME
from app.geometry import InputError
from app.runtime import Operator, SessionContent
from app.session import LiveImages, StepResult
from app.workflow import WorkflowOutput
from app.workflow.goal_pose import Plan


class LiveStepRun:
    """`app.runtime.StepRun` of the live node that runs the ``live.yaml`` at ``config``.

    The node is started with the first step and ends with the last one.
    """

    def __init__(
        self, config: str, workflow_of: Callable[[SessionContent], WorkflowOutput]
    ) -> None:
        self._config = config
        self._workflow_of = workflow_of
        self.workflow: WorkflowOutput | None = None
        """Guided recordings and breaches; None before the first step."""
        self.executed_plan = ""
        """JSON of the plan that an arm executes now; empty without one."""
        self.plan: Plan | None = None
        """Asks ``marginguard plan serve`` for an approach; None while there is no node."""
        self._client: SessionClient | None = None
        self._child: LiveChild | None = None
        self._stopped = False

    @property
    def operator(self) -> Operator | None:
        """Access of the panel to the session; None before the first step."""
        return None if self._client is None else self._client.operator

    @property
    def images(self) -> LiveImages | None:
        """Images of the session; None before the first step, and for one without images."""
        return None if self._client is None else self._client.images

    @property
    def delay_ns(self) -> int:
        """By how much the last step came later than others."""
        return 0 if self._client is None else self._client.delay_ns

    @property
    def silence(self) -> str:
        """The reason why no step comes; empty while that is not known."""
        if self._child is not None and self._child.ended:
            return self._child.ended
        return "" if self._client is None else self._client.silence

    def steps(self) -> Iterator[StepResult]:
        """Start the node and yield its steps as they come."""
        logging.info(prepare_environment())
        name = f"{PANEL_NODE}_{token_hex(3)}"
        child = self._child = LiveChild(
            [f"--config={self._config}", f"--display=/{name}"], logging.info
        )
        try:
            with RosNode(name) as ros:
                ExecutedPlan(ros, self._executes)
                self.plan = ApproachRequest(ros).plan
                client = self._client = SessionClient(ros, NODE_NAME, waiting=self._check, own=True)
                try:
                    if not self._stopped:
                        yield from self._followed(client)
                finally:
                    client.close()
        finally:
            self.executed_plan, self.plan = "", None
            child.close()

    def stop(self) -> None:
        """End `steps`; while the node is being started, as soon as it has started."""
        self._stopped = True
        if self._client is not None:
            self._client.stop()
        if self._child is not None:
            self._child.stop()

    def pace(self) -> float:
        """Live stamps advance in real time."""
        return 1.0

    def _followed(self, client: SessionClient) -> Iterator[StepResult]:
        for step in client.steps():
            assert client.operator is not None  # it comes with the first step
            content = client.operator.content
            if self.workflow is None:
                self.workflow = self._workflow_of(content)
                client.needs_every = lambda: (
                    self.workflow is not None and self.workflow.guided.is_recording
                )
            self.workflow.observe(step, content)
            yield step

    def _executes(self, plan: str) -> None:
        self.executed_plan = plan

    def _check(self, _silent_s: float) -> None:
        if self._child is not None and self._child.ended and self.operator is None:
            raise InputError(self._child.error)
