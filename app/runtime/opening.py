"""Open a case or a ``live.yaml`` and set up its session: the one sequence that all shells use."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from app.case import (
    Case,
    LiveCase,
    Playback,
    TrackingFrame,
    open_case,
    open_live,
)
from app.fixture import ProximityEngine
from app.geometry import NS_PER_S, InputError
from app.registration import RegistrationResult
from app.runtime.content import SessionContent, content_of
from app.session import (
    MakeEngine,
    SessionSetup,
    TrackingError,
    robot_from_case,
    setup_from_case,
    tumor_motion_parameters,
    with_estimated_clock,
    with_repaired_meshes,
)

if TYPE_CHECKING:
    from app.registration import TimeOffset  # imports scipy's splines, which is slow

OnStage = Callable[[str], None]
"""Called with the name of each stage of opening when it is done, to show progress."""


@dataclass(frozen=True, eq=False)
class PreparedCase:
    """A recorded case, repaired, synchronised and registered: ready to be replayed.

    ``clock`` is the estimated offset of the joints' clock, None where the case gives it.
    ``tip_only``: the tool is its tip alone.

    >>> import marginguard as mg
    >>> case = mg.open_case(mg.example_case())
    >>> case.content.registration.accepted, case.setup.margins.stop_mm
    (True, 1.0)
    """

    case: Case
    setup: SessionSetup
    content: SessionContent
    clock: "TimeOffset | None"
    tip_only: bool

    @cached_property
    def extent(self) -> "RecordingExtent":
        """Frames and duration; reads the recording once. Raises `InputError` for an empty one."""
        stamps = [frame.stamp.ns for frame in self.case.frames()]
        if not stamps:
            raise InputError(f"recording {self.case.recording_path}: 0 frames; expected 1 or more")
        return RecordingExtent(len(stamps), stamps[0], (stamps[-1] - stamps[0]) / NS_PER_S)


@dataclass(frozen=True, slots=True)
class RecordingExtent:
    """Number of frames, stamp of the first frame and duration from first to last."""

    frames: int
    first_ns: int
    duration_s: float


@dataclass(frozen=True, slots=True, eq=False)
class RegisteredCase:
    """A recorded case and the registration of its robot; ``clock`` as in `PreparedCase`."""

    case: Case
    registration: RegistrationResult
    clock: "TimeOffset | None"


@dataclass(frozen=True, slots=True, eq=False)
class PreparedLive:
    """A ``live.yaml`` whose case is repaired and whose session is set up."""

    config: LiveCase
    case: Case
    setup: SessionSetup
    content: SessionContent


def prepare_case(
    folder: Path,
    *,
    package_dirs: Sequence[Path] = (),
    tip_only: bool = False,
    tool: str | None = None,
    on_stage: OnStage = lambda stage: None,
    frames: tuple[TrackingFrame, ...] | None = None,
    make_engine: MakeEngine = ProximityEngine,
) -> PreparedCase:
    """Open the case in ``folder``, repair its tumour, estimate its clock, register its robot.

    ``tool`` names one of several tools. ``frames`` are those of a recording that was not written
    (`open_case`), ``make_engine`` is for `setup_from_case`. Takes seconds. Raises `InputError` for
    a case that cannot be used, and `FrameError` for a recording in which nothing connects the tool
    with the tumour.
    """
    case, clock = _open(folder, package_dirs, frames, tool)
    on_stage("open the case")
    setup = setup_from_case(case, tip_only=tip_only, make_engine=make_engine)
    content = content_of(case, setup, tip_only=tip_only)
    on_stage("meshes, robot, registration")
    return PreparedCase(case, setup, content, clock, tip_only)


def register_case(folder: Path, *, package_dirs: Sequence[Path] = ()) -> RegisteredCase:
    """Open the case in ``folder`` and register its robot; nothing else of the session is set up.

    Takes seconds. Raises `InputError` for a case that cannot be used or that has no robot.
    """
    case, clock = _open(folder, package_dirs)
    robot = robot_from_case(case)
    if robot is None or robot.registration is None:
        raise InputError(f"{folder} has no robot; expected a case with a registered robot")
    return RegisteredCase(case, robot.registration, clock)


def open_recording(folder: Path, *, package_dirs: Sequence[Path] = ()) -> Case:
    """Open the case in ``folder`` to read its samples; estimates the clock where it is not given.

    Raises `InputError` for a case that cannot be used.
    """
    case, _ = with_estimated_clock(open_case(folder, package_dirs=package_dirs))
    return case


def playback_of(
    case: Case,
    *,
    clock_ns: Callable[[], int],
    host_ns: Callable[[], int],
    rate: float = 1.0,
    loop: bool = False,
    start_s: float = 0.0,
) -> Playback:
    """A `Playback` of the recorded samples of ``case``, with the arguments of that class.

    With ``loop`` the pause between two passes is twice the limit for stale poses, or 1 s.
    """
    manifest = case.manifest
    return Playback(
        case.recorded_frames,
        offset_robot_to_tracker_ns=manifest.clock.offset_robot_to_tracker_ns,
        clock_ns=clock_ns,
        host_ns=host_ns,
        rate=rate,
        loop=loop,
        start_s=start_s,
        pause_ns=max(NS_PER_S, 2 * manifest.margins.stale_after_ns),
    )


def prepare_live(
    config_file: Path, *, package_dirs: Sequence[Path] = (), tool: str | None = None
) -> PreparedLive:
    """Open a ``live.yaml`` and set up its session. Raises as `prepare_case` does."""
    config = open_live(config_file, package_dirs=package_dirs)
    config = replace(config, case=config.case.for_tool(tool))
    case = with_repaired_meshes(config.case)
    setup = setup_from_case(case)
    setup = replace(
        setup,
        tumor_motion=tumor_motion_parameters(config),
        motion_frame=config.motion_frame,
        tracking=TrackingError(config.latency_ns, config.sigma_mm, config.sigma_rad),
    )
    return PreparedLive(config, case, setup, content_of(case, setup, tip_only=False))


def _open(
    folder: Path,
    package_dirs: Sequence[Path],
    frames: tuple[TrackingFrame, ...] | None = None,
    tool: str | None = None,
) -> "tuple[Case, TimeOffset | None]":
    """Open the case, repair its tumour and estimate the offset of its joints' clock."""
    opened = open_case(folder, package_dirs=package_dirs, frames=frames).for_tool(tool)
    return with_estimated_clock(with_repaired_meshes(opened))
