"""The steps of a live session on their way to a page: each with the content it was taken with."""

import sys
from concurrent.futures import Executor, Future

from app.geometry import MarginGuardError, SurfaceMesh
from app.runtime import Operator, SessionContent
from app.session import StepResult
from app.viewer.steps.feeds import LiveFeed
from app.workflow import Workflow, stop_surface


class LiveSteps:
    """Puts every step of a session that began with ``content`` into ``feed``.

    The margin surface of another tumour or stop margin takes a second to compute in ``workers``;
    until then there is none, never that of the content before.
    ``workflow`` records the poses.
    """

    def __init__(
        self,
        feed: LiveFeed,
        content: SessionContent,
        margin_surface: SurfaceMesh | None,
        workers: Executor,
        workflow: Workflow | None = None,
    ) -> None:
        self._feed = feed
        self._content = content
        self._margin_surface = margin_surface
        self._workers = workers
        self._workflow = workflow
        self._computing: Future[SurfaceMesh | None] | None = None

    def put(self, step: StepResult, operator: Operator, delay_ns: int = 0) -> None:
        """Take the next step, with what ``operator`` says of the session at this moment.

        ``delay_ns``: how much later than usual it came.
        """
        self._use(operator.content)
        if self._computing is not None and self._computing.done():
            self._margin_surface = _result(self._computing)
            self._computing = None
        if self._workflow is not None:
            self._workflow.observe(step)
        self._feed.put(step, self._content, self._margin_surface, operator.seen(), delay_ns)
        self._feed.list_of_session(operator.last_request)

    def _use(self, content: SessionContent) -> None:
        before, self._content = self._content, content
        is_same_stop = content.margins.stop_mm == before.margins.stop_mm
        if content.tumor is before.tumor and is_same_stop:
            return
        self._margin_surface = None
        self._computing = self._workers.submit(stop_surface, content)


def _result(computing: "Future[SurfaceMesh | None]") -> SurfaceMesh | None:
    """The surface; None where it cannot be made, which does not end the session."""
    try:
        return computing.result()
    except MarginGuardError as error:
        print(f"no margin surface is shown: {error}", file=sys.stderr)
        return None
