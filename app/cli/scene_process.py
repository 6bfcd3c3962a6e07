"""Draws the picture of one moment in a process of its own: ``python -m app.cli.scene_process``.

It loads 3D Slicer's scene, which takes seconds, and only then reads the moment to draw, pickled,
from standard input. The PNG goes to standard output; where it cannot be made there is none, and
standard error says why. When the input ends without a moment it ends quietly.
"""

import os
import pickle
import sys
from typing import IO, Any


def main() -> None:
    """Draw the one moment that is asked for."""
    # What a library prints must not get among the bytes of the picture.
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as answer:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        answer.write(_drawn(sys.stdin.buffer))


def _drawn(request: IO[bytes]) -> bytes:
    try:
        from app.scene import Moment, OffscreenError, SceneError, ShownRobot, moment_png
    except ImportError as error:
        return _none(f"{error}; 'marginguard doctor' says what to install")
    try:
        values: dict[str, Any] = pickle.load(request)
    except EOFError:
        return b""
    robot = values.pop("robot")
    moment = Moment(robot=None if robot is None else ShownRobot(**robot), **values)
    try:
        return moment_png(moment)
    except (OffscreenError, SceneError) as error:
        return _none(str(error))


def _none(reason: str) -> bytes:
    print(f"no scene.png: {reason}", file=sys.stderr)
    return b""


if __name__ == "__main__":
    main()
