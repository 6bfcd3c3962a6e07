"""Draws what a replay shows in a process of its own: ``python -m app.cli.scene_process``.

It loads 3D Slicer's scene and what draws it, which takes seconds, and only then reads what is
wanted, pickled, from standard input. The answer goes to standard output, pickled: by name the
bytes, or why there are none. When the input ends without a request it ends quietly.
"""

import os
import pickle
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING

from app.cli.gc_control import GcPause
from app.cli.scene_picture import MOVIE, PICTURE, SCENE

if TYPE_CHECKING:
    from app.cli.scene_picture import SceneRequest

SCENE_NAME = "scene.mrb"

_SMALL = (160, 120)
"""Width and height of a picture that nobody sees."""


def main() -> None:
    """Answer the one request."""
    # What a library prints must not get among the bytes of the answer.
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as answer, GcPause() as memory:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        answer.write(_answered(sys.stdin.buffer, memory))
    sys.stderr.flush()
    # All is delivered; native libraries that are torn down have crashed here.
    os._exit(0)


def _answered(stream: IO[bytes], memory: GcPause) -> bytes:
    try:
        _load()
        memory.settle()
    except ImportError as error:
        request = _read(stream)
        reason = f"{error}; 'marginguard doctor' says what to install"
        return pickle.dumps(dict.fromkeys(request.outputs, reason)) if request else b""
    request = _read(stream)
    if request is None:
        return b""
    return pickle.dumps({output: _content(output, request) for output in request.outputs})


def _load() -> None:
    """Load all that a picture needs, and draw one: the first one in a process takes longest."""
    from app.cli.render_warmup import warmup_step
    from app.scene import OffscreenError, step_png

    # Why nothing can be drawn is said when a picture is asked for; a scene file needs none.
    with suppress(OffscreenError):
        step_png(*warmup_step(), _SMALL)


def _read(stream: IO[bytes]) -> "SceneRequest | None":
    try:
        request: SceneRequest = pickle.load(stream)
    except EOFError:
        return None
    return request


def _content(output: str, request: "SceneRequest") -> bytes | str:
    from app.geometry import MarginGuardError

    try:
        return _MAKERS[output](request)
    except MarginGuardError as error:
        return str(error)


def _picture(request: "SceneRequest") -> bytes:
    from app.scene import step_png

    return step_png(request.content, request.step)


def _scene(request: "SceneRequest") -> bytes:
    from app.scene import SceneError, StepScene, add_sequences, save_scene

    shown = StepScene(request.content, request.step)
    now_ns = request.step.frame.stamp.ns
    try:
        add_sequences(shown.scene, request.frames, request.states, now_ns)
    except SceneError as error:
        print(f"the scene is saved without the recording: {error}", file=sys.stderr)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / SCENE_NAME
        save_scene(shown.application.scene, path)
        return path.read_bytes()


def _movie(request: "SceneRequest") -> bytes:
    from app.scene import movie_gif

    return movie_gif(request.content, request.step, request.keyframes)


_MAKERS = {PICTURE: _picture, SCENE: _scene, MOVIE: _movie}


if __name__ == "__main__":
    main()
