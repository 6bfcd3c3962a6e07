"""The drawing process: ``python -m app.cli.scene_process``.

It loads 3D Slicer's scene and the renderer, which takes seconds, and then reads one pickled
`SceneRequest` from standard input. It writes a pickled dict to standard output: for each output the
bytes, or the reason why there are none. Without a request it ends silently.
"""

import pickle
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING

from app.cli.process import GcPause
from app.cli.scene_picture import MOVIE, PICTURE, SCENE, VIDEO
from app.files.child_process import answer_request
from app.files.extras import install_hint
from app.geometry import MarginGuardError

if TYPE_CHECKING:
    from app.cli.scene_picture import SceneRequest
    from app.geometry import SurfaceMesh
    from app.runtime import SessionContent
    from app.session import StepResult


SCENE_NAME = "scene.mrb"

_WARMUP_SIZE = (160, 120)
"""Width and height of the warm-up picture."""

_WARMUP_DISTANCE_MM = 10.0


def main() -> None:
    """Answer one request."""
    with GcPause() as memory:
        answer_request(lambda stream: [_answered(stream, memory)])


def _answered(stream: IO[bytes], memory: GcPause) -> bytes:
    try:
        _load()
        memory.settle()
    except ImportError as error:
        request = _read(stream)
        reason = f"3D Slicer's scene cannot be loaded ({error}): {install_hint(error)}"
        return pickle.dumps(dict.fromkeys(request.outputs, reason)) if request else b""
    request = _read(stream)
    if request is None:
        return b""
    return pickle.dumps({output: _content(output, request) for output in request.outputs})


def _load() -> None:
    """Load what a picture needs, and draw one: the first picture of a process is slow."""
    from app.scene import OffscreenError, load_3d_view_only, step_png

    load_3d_view_only()
    # A picture that is requested reports the error; a scene file needs no renderer.
    with suppress(OffscreenError):
        step_png(*warmup_step(), _WARMUP_SIZE)


def _read(stream: IO[bytes]) -> "SceneRequest | None":
    try:
        request: SceneRequest = pickle.load(stream)
    except EOFError:
        return None
    return request


def _content(output: str, request: "SceneRequest") -> bytes | str:
    from app.scene import movie_gif, movie_mp4, step_png

    try:
        if output == SCENE:
            return _scene(request)
        if output == PICTURE:
            return step_png(request.content, request.step)
        make_movie = {MOVIE: movie_gif, VIDEO: movie_mp4}[output]
        return make_movie(request.content, request.step, request.keyframes)
    except MarginGuardError as error:
        return str(error)


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


def warmup_step() -> "tuple[SessionContent, StepResult]":
    """A pyramid as tool above a pyramid as tumour, with closest points and a constraint plane.

    The first picture of a process takes twice as long as the next: libraries are loaded when they
    are first used, and shaders are compiled for the driver.
    """
    import numpy as np

    from app.case import TrackingFrame
    from app.fixture import (
        Constraint,
        FixtureDecision,
        MarginParameters,
        MarginState,
        Proximity,
        Reason,
        Witnesses,
    )
    from app.geometry import NS_PER_MS, Stamp, TrackedTransform, TrackingStatus, Transform
    from app.runtime import SessionContent
    from app.session import StepResult

    stale_ns = 200 * NS_PER_MS
    above, tip, up = (0.0, 0.0, _WARMUP_DISTANCE_MM), np.zeros(3), np.array([0.0, 0.0, 1.0])
    nearest = Witnesses.single(_WARMUP_DISTANCE_MM, np.array(above), tip, up)
    plane = np.array([up])
    decision = FixtureDecision(
        state=MarginState.NEGATIVE,
        reasons=(Reason.CLEAR,),
        proximity=Proximity(_WARMUP_DISTANCE_MM, nearest, None),
        margin=None,
        constraint=Constraint(
            "tumor", plane, np.zeros(1), np.array([above]), np.zeros((1, 3)), hold=False
        ),
        hold=False,
        stamp=None,
        seq=1,
        constraint_is_current=True,
    )
    content = SessionContent(
        name="warm-up",
        tumor=_pyramid("tumor"),
        tool=_pyramid("tool_tip"),
        tip_frame="tool_tip",
        static_edges=(
            Transform.identity("sensor", "tumor"),
            Transform.identity("tool", "tool_tip"),
        ),
        margins=MarginParameters(
            stop_mm=1.0,
            warn_mm=5.0,
            k_tre=0.0,
            v_max_mm_s=0.0,
            stale_after_ns=stale_ns,
            release_samples=1,
            release_band_mm=0.0,
            frozen_after_ns=stale_ns,
        ),
    )
    stamp = Stamp(0)
    poses = (
        Transform.identity("tracker", "sensor"),
        Transform("tracker", "tool", np.eye(3), np.array(above)),
    )
    samples = tuple(TrackedTransform(pose, stamp, TrackingStatus.OK) for pose in poses)
    step = StepResult(
        index=0,
        frame=TrackingFrame(stamp, samples),
        decision=decision,
        tumor_from_tip=None,
        virtual_fixture=None,
        links={},
        joints=None,
    )
    return content, step


def _pyramid(frame: str) -> "SurfaceMesh":
    import numpy as np

    from app.geometry import SurfaceMesh

    corners = np.array([[0, 0, 0], [1, 0, -3], [-1, 1, -3], [-1, -1, -3]], dtype=np.float64)
    return SurfaceMesh(frame, corners, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]))


if __name__ == "__main__":
    main()
