"""Writes the messages of a replay to a bag, in another process, while the replay goes on."""

import pickle
import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Self

from app.files.atomic_io import new_folder
from app.files.child_process import started_behind
from app.geometry import InputError

if TYPE_CHECKING:
    from app.runtime import ReplayRun, SessionContent, StepTiming, SwitchContent
    from app.session import StepResult

_STEPS_PER_MESSAGE = 64
_MAX_WAITING = 128
"""Messages that wait for the process, about 40 MB; the replay then waits for it."""


@dataclass(frozen=True, slots=True)
class BagAnswer:
    """``problem``: why there is no bag, empty where it is complete. ``processor_s``: time used."""

    problem: str = ""
    processor_s: float = 0.0


class _CancelledError(Exception):
    """The replay was stopped: its bag is not kept."""


class BagProcess:
    """`Output` that writes the messages of a replay, as `app.bridge.SessionBag` makes them.

    The process starts with the context and loads ROS while the case is prepared; it is killed at
    the end of the context. `begin` adds this output to a run, `finish` waits for the bag.
    """

    def __enter__(self) -> Self:
        self._process = started_behind("app.cli.bag_process")
        self._steps: list[StepResult] = []
        self._waiting: queue.Queue[bytes | None] = queue.Queue(_MAX_WAITING)
        self._sender = threading.Thread(target=self._send_all, args=(self._process.stdin,))
        self._sender.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._waiting.put(None)  # the thread empties the queue, also after the process has ended
        self._sender.join()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                with suppress(BrokenPipeError):
                    stream.close()

    def begin(self, run: "ReplayRun", folder: Path) -> None:
        """Write the steps of ``run`` from now on, into the new rosbag2 folder ``folder``."""
        self._content = run.commands.content
        self._put((self._content, run.prepared.case.manifest, folder.absolute()))
        run.outputs.append(self)

    def finish(self) -> BagAnswer:
        """Wait until the bag is complete. Raises `InputError` if it could not be written."""
        self._flush()
        self._put(None)
        with suppress(EOFError, pickle.UnpicklingError):
            answer: BagAnswer = pickle.load(self._process.stdout)  # type: ignore[arg-type]
            if answer.problem:
                raise InputError(f"bag: {answer.problem}")
            return answer
        raise InputError(
            f"bag: the process that writes it ended with status {self._process.wait()}"
        )

    def publish(self, step: "StepResult", timing: "StepTiming") -> bool:
        """Send ``step`` with others to the process. No step is too late."""
        self._steps.append(step)
        if len(self._steps) >= _STEPS_PER_MESSAGE:
            self._flush()
        return True

    def prepare(self, content: "SessionContent") -> "SwitchContent":
        """Return the switch: steps that follow it are written with the other content."""
        return self._use

    def revoke(self) -> None:
        """Nothing to withdraw."""

    def latch(self, causes: Sequence[str]) -> None:
        """Write the hold."""
        self._add("latch", tuple(causes))

    def end(self) -> None:
        """Write a last constraint on hold."""
        self._add("end", None)

    def _use(self, content: "SessionContent") -> None:
        """Send the fields that are new: the others stay the same objects in the process."""
        before, self._content = self._content, content
        changes = {
            name: value
            for name in (field.name for field in fields(content))
            if (value := getattr(content, name)) is not getattr(before, name)
        }
        if content.static_edges == before.static_edges:
            changes.pop("static_edges", None)
        self._add("content", changes)

    def _flush(self) -> None:
        if self._steps:
            from app.session.step_result import pickled_steps

            self._put(("steps", pickled_steps(self._steps)))
            self._steps = []

    def _add(self, name: str, value: Any) -> None:
        self._flush()
        self._put((name, value))

    def _put(self, message: object) -> None:
        self._waiting.put(pickle.dumps(message, pickle.HIGHEST_PROTOCOL))

    def _send_all(self, stream: IO[bytes]) -> None:
        """Pass on what waits; nothing more once the process has ended."""
        ended = False
        while (data := self._waiting.get()) is not None:
            if not ended:
                try:
                    stream.write(data)
                    stream.flush()
                except (BrokenPipeError, ValueError):
                    ended = True


@contextmanager
def bag_of(
    process: BagProcess, run: "ReplayRun", folder: Path, keep: Callable[[], bool]
) -> Iterator[None]:
    """Within the context the steps of ``run`` are written to the new rosbag2 folder ``folder``.

    It appears complete at the end, unless the body raises or ``keep()`` is false. Raises
    `InputError` for a folder that exists or cannot be written.
    """
    with suppress(_CancelledError), new_folder(folder) as partial:
        partial.rmdir()  # the bag creates its folder
        process.begin(run, partial)
        yield
        if not keep():
            raise _CancelledError
        process.finish()
