"""A live session with its outputs: every step is published as it happens."""

from collections.abc import Generator, Sequence
from contextlib import ExitStack, closing

from app.hold import Holds
from app.runtime.case_recorder import CaseRecorder
from app.runtime.commands import OperatorCommands
from app.runtime.compute import Compute, compute_here
from app.runtime.content import SessionContent
from app.runtime.hold_keeper import HoldKeeper
from app.runtime.new_tumor import MAX_LIVE_TRIANGLES
from app.runtime.outputs import Output, StepHolds, StepTiming
from app.runtime.requests import RequestLog
from app.session import LiveSession, StepResult


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
