"""Draws a replay in 3D Slicer's scene, in another process: a picture, a scene file, a movie."""

import pickle
import sys
from collections.abc import Collection
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from app.files.child_process import started_behind
from app.geometry import InputError

if TYPE_CHECKING:
    from app.cli.scene_log import SceneLog
    from app.fixture import MarginState, Reason
    from app.geometry import TrackedTransform
    from app.runtime import SessionContent
    from app.session import StepResult

PICTURE, SCENE, MOVIE, VIDEO = "picture", "scene", "movie", "video"
"""The outputs of a `SceneRequest`; a movie is a GIF, a video is an MP4 file."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneRequest:
    """The input of the drawing process: ``outputs`` of one ``step`` of a session.

    For the sequences of a scene file ``frames`` are the samples of each acquisition, and ``states``
    the stamp in ns, the state and the reasons of each step. ``keyframes`` are the steps of a movie
    with their times in s.
    """

    content: "SessionContent"
    step: "StepResult"
    outputs: tuple[str, ...]
    frames: "tuple[tuple[TrackedTransform, ...], ...]" = ()
    states: "tuple[tuple[int, MarginState, tuple[Reason, ...]], ...]" = ()
    keyframes: "tuple[tuple[float, StepResult], ...]" = ()


class ScenePainter:
    """Draws in a process of its own: `begin` starts it, `picture` and `content` wait for results.

    The process starts with the context and loads Slicer's scene while the case is replayed. It is
    killed at the end of the context.
    """

    def __enter__(self) -> Self:
        self._process = started_behind("app.cli.scene_process")
        # The request waits in a thread until the process is ready; the replay does not wait.
        self._waiting = ThreadPoolExecutor(max_workers=1)
        self._answer: Future[tuple[bytes, bytes]] | None = None
        self._answered: dict[str, bytes | str] | None = None
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._waiting.shutdown()
        self._process.communicate()

    def begin(
        self,
        content: "SessionContent",
        step: "StepResult",
        *,
        outputs: Collection[str] = (PICTURE,),
        log: "SceneLog | None" = None,
    ) -> None:
        """Start to draw ``outputs`` of ``step``; ``log`` has what a scene and a movie need."""
        request = SceneRequest(
            content=content,
            step=step,
            outputs=tuple(outputs),
            frames=() if log is None else tuple(log.frames),
            states=() if log is None else tuple(log.states),
            keyframes=() if log is None else tuple(log.keyframes()),
        )
        # Protocol 5 and later restore read-only arrays as read-only.
        sent = pickle.dumps(request, pickle.HIGHEST_PROTOCOL)
        self._answer = self._waiting.submit(self._process.communicate, sent)

    def picture(self) -> bytes | None:
        """Wait for the PNG; None if nothing was begun, or with a message on stderr if it failed."""
        if self._answer is None:
            return None
        content = self._contents().get(PICTURE, "it was not requested")
        if isinstance(content, str):
            print(f"no scene.png: {content}", file=sys.stderr)
            return None
        return content

    def content(self, name: str) -> bytes:
        """Wait for the file ``name``, not a picture. Raises `InputError` if it failed."""
        content = (
            "the distance of the tool to the tumour was never known"
            if self._answer is None
            else self._contents().get(name, "it was not requested")
        )
        if isinstance(content, str):
            raise InputError(f"no {name}: {content}")
        return content

    def _contents(self) -> dict[str, bytes | str]:
        """By name the bytes, or the reason why there are none."""
        if self._answered is None and self._answer is not None:
            answer, _ = self._answer.result()
            self._answered = _unpacked(answer, self._process.returncode)
        return self._answered or {}


def _unpacked(answer: bytes, status: int) -> dict[str, bytes | str]:
    """Decode the answer. A complete answer is used whatever the exit status."""
    ended = f"the drawing process ended with status {status}"
    try:
        contents: dict[str, bytes | str] = pickle.loads(answer)
    except (pickle.UnpicklingError, EOFError):
        return dict.fromkeys((PICTURE, SCENE, MOVIE, VIDEO), ended)
    if status != 0:
        print(f"{ended} after it had drawn everything", file=sys.stderr)
    return contents
