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
from typing import IO, TYPE_CHECKING, Any

from app.cli.gc_control import GcPause
from app.cli.scene_picture import MOVIE, PICTURE, SCENE

if TYPE_CHECKING:
    from app.scene import Moment

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
        return pickle.dumps(dict.fromkeys(request["wanted"], reason)) if request else b""
    request = _read(stream)
    if request is None:
        return b""
    return pickle.dumps({name: _content(name, request) for name in request["wanted"]})


def _load() -> None:
    """Load all that a picture needs, and draw one: the first one in a process takes longest."""
    from app.cli.render_warmup import rehearsal
    from app.scene import OffscreenError, moment_png

    # Why nothing can be drawn is said when a picture is asked for; a scene file needs none.
    with suppress(OffscreenError):
        moment_png(rehearsal(), _SMALL)


def _read(stream: IO[bytes]) -> dict[str, Any] | None:
    try:
        request: dict[str, Any] = pickle.load(stream)
    except EOFError:
        return None
    return request


def _content(name: str, request: dict[str, Any]) -> bytes | str:
    from app.geometry import MarginGuardError

    try:
        return _MAKERS[name](_moment(request["moment"]), request)
    except MarginGuardError as error:
        return str(error)


def _picture(moment: "Moment", _: dict[str, Any]) -> bytes:
    from app.scene import moment_png

    return moment_png(moment)


def _scene(moment: "Moment", request: dict[str, Any]) -> bytes:
    from app.scene import MomentScene, SceneError, add_sequences, save_scene

    shown = MomentScene(moment)
    try:
        add_sequences(shown.scene, request["frames"], request["states"], request["now_ns"])
    except SceneError as error:
        print(f"the scene is saved without the recording: {error}", file=sys.stderr)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / SCENE_NAME
        save_scene(shown.application.scene, path)
        return path.read_bytes()


def _movie(moment: "Moment", request: dict[str, Any]) -> bytes:
    from app.scene import movie_gif

    return movie_gif(moment, [(time_s, _moment(one)) for time_s, one in request["moments"]])


def _moment(values: dict[str, Any]) -> "Moment":
    from app.scene import Moment, ShownRobot

    robot = values["robot"]
    return Moment(**values | {"robot": None if robot is None else ShownRobot(**robot)})


_MAKERS = {PICTURE: _picture, SCENE: _scene, MOVIE: _movie}


if __name__ == "__main__":
    main()
