"""What 3D Slicer's scene gives of a replay: the picture of its deepest moment, a file, a movie."""

import os
import pickle
import subprocess
import sys
from collections.abc import Collection
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from app.case import Case
    from app.cli.scene_log import SceneLog
    from app.session import SessionSetup, StepResult

PICTURE, SCENE, MOVIE = "picture", "scene", "movie"
"""What can be asked for."""


class ScenePainter:
    """Draws beside the replay: `begin` says what, `picture` and `content` wait for it.

    The process that draws starts with the context and loads Slicer's scene while the case is
    replayed. It ends with the context, whatever it is doing then.
    """

    def __enter__(self) -> Self:
        # The process finds this package from wherever it is started.
        paths = [str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH")]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "app.cli.scene_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))},
            start_new_session=True,  # Ctrl-C on the terminal is the replay's alone
        )
        # The request waits in a thread for the process to be ready, the replay's end does not.
        self._waiting = ThreadPoolExecutor(max_workers=1)
        self._answer: Future[tuple[bytes, bytes]] | None = None
        self._answered: dict[str, bytes | str] | None = None
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._process.kill()
        self._waiting.shutdown()
        self._process.communicate()

    def begin(
        self,
        case: "Case",
        setup: "SessionSetup",
        step: "StepResult",
        *,
        with_tool: bool,
        wanted: Collection[str] = (PICTURE,),
        log: "SceneLog | None" = None,
    ) -> None:
        """Have ``step`` drawn, and what else is ``wanted``; ``log`` has the replay for that."""
        from app.geometry import NS_PER_S

        moment = _moment(case, setup, step, with_tool=with_tool)
        request: dict[str, Any] = {
            "moment": moment,
            "wanted": tuple(wanted),
            "now_ns": step.frame.stamp.ns,
        }
        if log is not None and SCENE in wanted:
            request["frames"], request["states"] = log.frames, log.states
        if log is not None and log.reel is not None and log.first_ns is not None:
            request["moments"] = [
                (
                    (one.frame.stamp.ns - log.first_ns) / NS_PER_S,
                    # The same meshes: pickled once.
                    moment | _moving(setup, one),
                )
                for one in log.reel.steps()
            ]
        # From protocol 5 on what was read-only is so again in the process.
        sent = pickle.dumps(request, pickle.HIGHEST_PROTOCOL)
        self._answer = self._waiting.submit(self._process.communicate, sent)

    def picture(self) -> bytes | None:
        """The PNG of what was begun; None where nothing was, or, said on stderr, it cannot be."""
        if self._answer is None:
            return None
        content = self._contents().get(PICTURE, "it was not asked for")
        if isinstance(content, str):
            print(f"no scene.png: {content}", file=sys.stderr)
            return None
        return content

    def content(self, name: str) -> bytes:
        """The file of what was begun, `SCENE` or `MOVIE`; `InputError` where it cannot be."""
        content = (
            "the distance of the tool to the tumour was never known"
            if self._answer is None
            else self._contents().get(name, "it was not asked for")
        )
        if isinstance(content, str):
            from app.geometry import InputError

            raise InputError(f"no {name}: {content}")
        return content

    def _contents(self) -> dict[str, bytes | str]:
        """By name the content, or why there is none."""
        if self._answered is None and self._answer is not None:
            answer, _ = self._answer.result()
            self._answered = _unpacked(answer, self._process.returncode)
        return self._answered or {}


def _unpacked(answer: bytes, status: int) -> dict[str, bytes | str]:
    """What the process said. An answer that is whole counts, however the process ended."""
    try:
        contents: dict[str, bytes | str] = pickle.loads(answer)
    except (pickle.UnpicklingError, EOFError):
        return dict.fromkeys((PICTURE, SCENE, MOVIE), f"drawing it ended with status {status}")
    if status != 0:
        print(f"drawing the scene ended with status {status}, after all was drawn", file=sys.stderr)
    return contents


def _moment(
    case: "Case", setup: "SessionSetup", step: "StepResult", *, with_tool: bool
) -> dict[str, Any]:
    """The values of `app.scene.Moment`, which cannot be made here without loading the scene."""
    return {
        "tumor": case.tumor_mesh(),
        "tool": case.tool_mesh() if with_tool else None,
        "tip_frame": case.manifest.tool.tip_frame,
        "fixed": setup.static_edges,
        **_moving(setup, step),
    }


def _moving(setup: "SessionSetup", step: "StepResult") -> dict[str, Any]:
    """The values of a moment that are others at each step."""
    robot = setup.robot
    return {
        "decision": step.decision,
        "measured": tuple(
            pose.transform for pose in step.frame.poses if pose.transform is not None
        ),
        "tumor_from_tip": step.tumor_from_tip,
        "robot": {
            "robot": robot.robot,
            "base_frame": robot.base_frame,
            "links": step.links,
            "tool_link": robot.tool_link,
        }
        if robot is not None and step.links
        else None,
    }
