"""The picture of the deepest moment, from 3D Slicer's scene where the machine can draw one."""

import os
import pickle
import subprocess
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from app.case import Case
    from app.session import SessionSetup, StepResult


class ScenePainter:
    """Draws beside the replay: `begin` says what, `picture` waits for it.

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
        self, case: "Case", setup: "SessionSetup", step: "StepResult", *, with_tool: bool
    ) -> None:
        """Have ``step`` drawn."""
        request = pickle.dumps(_moment(case, setup, step, with_tool=with_tool))
        self._answer = self._waiting.submit(self._process.communicate, request)

    def picture(self) -> bytes | None:
        """The PNG of what was begun; None where nothing was, or, said on stderr, it cannot be."""
        if self._answer is None:
            return None
        png, _ = self._answer.result()
        status = self._process.returncode
        if status != 0:
            print(f"no scene.png: drawing it ended with status {status}", file=sys.stderr)
            return None
        return png or None  # it has said why


def _moment(
    case: "Case", setup: "SessionSetup", step: "StepResult", *, with_tool: bool
) -> dict[str, Any]:
    """The values of `app.scene.Moment`, which cannot be made here without loading the scene."""
    robot = setup.robot
    return {
        "decision": step.decision,
        "tumor": case.tumor_mesh(),
        "tool": case.tool_mesh() if with_tool else None,
        "tip_frame": case.manifest.tool.tip_frame,
        "measured": tuple(
            pose.transform for pose in step.frame.poses if pose.transform is not None
        ),
        "fixed": setup.static_edges,
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
