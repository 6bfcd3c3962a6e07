"""A live session with its outputs: every step is published as it happens."""

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import asdict
from typing import Any, Protocol

from app.fixture import Reason
from app.geometry import TrackedTransform, Transform
from app.hold import Holds, LiveState
from app.runtime.case_recorder import CaseRecorder
from app.runtime.commands import OperatorCommands
from app.runtime.compute import Compute, compute_here
from app.runtime.content import SessionContent, surface_digest
from app.runtime.outputs import Output, StepHolds, StepTiming
from app.runtime.requests import RequestLog
from app.runtime.session_changes import MAX_LIVE_TRIANGLES
from app.session import LiveSession, StepResult


class HoldKeeper:
    """Begins a session on hold where ``state`` demands it, and notes the values that it uses.

    At the end it notes how the session has ended.

    ``has_expired()`` is True while a constraint has become stale that no step has replaced yet: the
    hold that it began is not latched in the session.
    """

    def __init__(self, state: LiveState, has_expired: Callable[[], bool]) -> None:
        self._state = state
        self._has_expired = has_expired
        self._begun = False
        self._content: SessionContent | None = None

    @contextmanager
    def kept(self, live: LiveSession) -> Iterator[None]:
        """Within the context the steps of ``live`` are taken."""
        if not self._begun:
            self._begun = True
            for cause in self._state.start_causes:
                # The last run may have doubted the pose, which is plausible from its first sample.
                live.hold(cause, doubt=True)
        self._state.resume()
        try:
            yield
        except BaseException as error:  # also of the reader of the steps
            reason = str(error) or type(error).__name__  # a reader that leaves: GeneratorExit
            self._state.update(True, (*self._causes(live), f"the session has failed: {reason}"))
            raise
        with live.between_steps() as session:
            latched = session.latched or self._has_expired()
            self._state.end(latched, session.hold_causes)

    def note(self, step: StepResult, content: SessionContent) -> None:
        """Note the hold of ``step``, and ``content`` if it is another one. Returns at once."""
        if content is not self._content:
            self._content = content
            self._state.use(used_values(content))
        self._state.update(Reason.LATCHED in step.decision.reasons, step.hold_causes)

    def _causes(self, live: LiveSession) -> tuple[str, ...]:
        with live.between_steps() as session:
            return session.hold_causes


def used_values(content: SessionContent) -> dict[str, Any]:
    """The values of ``content``: equal ones permit the same."""
    registration, depth = content.registration, content.image_depth
    return {
        "tumor": {
            "surface": content.model_id,
            "pose": _pose(content.frame_from_tumor),
            "sigma_mm": float(content.tumor_sigma_mm),
        },
        "tip": {"pose": _pose(content.tool_from_tip), "sigma_mm": float(content.tip_sigma_mm)},
        "registration": None if registration is None else _pose(registration.transform),
        "margins": asdict(content.margins),
        "image_depth_mm": None if depth is None else float(depth.depth_mm),
        "structures": {
            each.name: {
                "surface": surface_digest(each.surface),
                "pose": _pose(content.static_edge(each.name)),
                "sigma_mm": float(each.sigma_mm),
                "stop_mm": float(each.stop_mm),
                "warn_mm": float(each.warn_mm),
            }
            for each in content.structures
        },
    }


def _pose(transform: Transform) -> list[Any]:
    return [transform.target, transform.source, transform.matrix.ravel().tolist()]


class LiveRun:
    """``for step in run.steps(): ...`` publishes each step to ``outputs``, in their order.

    When an output reports that a step came too late, the session latches a hold and all outputs
    withdraw what they permitted. ``commands`` changes the session from any thread; ``holds``
    identifies the hold that an output publishes, by default that of the last step; ``requests``
    lists what is requested; ``compute`` prepares a new tumour; ``recorder`` records the session.
    ``keeper`` keeps the hold of each step and the values in use for the next run.
    """

    def __init__(
        self,
        live: LiveSession,
        content: SessionContent,
        outputs: Sequence[Output],
        keeper: HoldKeeper | None = None,
        *,
        holds: Holds | None = None,
        requests: RequestLog | None = None,
        compute: Compute = compute_here,
        recorder: CaseRecorder | None = None,
    ) -> None:
        self.live = live
        if holds is None:
            holds = step_holds = StepHolds()
            outputs = (step_holds, *outputs)
        self.outputs = tuple(outputs)
        self._keeper = keeper
        self.commands = OperatorCommands(
            live.between_steps,
            content,
            self.outputs,
            holds=holds,
            max_triangles=MAX_LIVE_TRIANGLES,
            requests=requests,
            compute=compute,
            recorder=recorder,
        )

    def steps(self) -> Generator[StepResult]:
        """Publish and yield each step as it happens; ends with `stop`.

        At the end, also after an error, every output has withdrawn what it permitted and has
        published its final state.
        """
        with ExitStack() as at_end:
            # In reverse order: all permissions are withdrawn before the first output ends.
            for output in self.outputs:
                at_end.callback(self._end, output)
            for output in self.outputs:
                at_end.callback(output.revoke)
            if self._keeper is not None:
                at_end.enter_context(self._keeper.kept(self.live))
            # Close at once: otherwise an error would keep the session locked.
            with closing(self.live.steps()) as steps:
                for step in steps:
                    self._publish(step)
                    if self._keeper is not None:
                        self._keeper.note(step, self.commands.content)
                    yield step

    def stop(self) -> None:
        """End `steps` soon; from any thread."""
        self.live.stop()

    def _publish(self, step: StepResult) -> None:
        in_time = True
        for output in self.outputs:
            timing = StepTiming(
                spent_ns=self.live.spent_ns(), in_time=in_time, clock=self.live.spent_ns
            )
            if not output.publish(step, timing) and in_time:
                in_time = False
                self.live.hold("a step came later than its data are valid")
                for each in self.outputs:
                    each.revoke()

    def _end(self, output: Output) -> None:
        with self.live.between_steps():
            output.end()


Deliver = Callable[[Sequence[TrackedTransform]], None]
"""Takes samples that arrived together, from any thread, without waiting."""


class Source(Protocol):
    """A tracker: it delivers samples from its construction until `close`.

    Stamps are the source's own. A lost pose is delivered too, with its status. A sample that
    cannot be used is dropped and counted.
    """

    def counts(self) -> Mapping[str, int]:
        """Counts of received and dropped samples, for diagnostics."""

    def close(self) -> None:
        """Stop delivering. A second call does nothing."""
