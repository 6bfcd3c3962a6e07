"""A planned corridor beside a session: where its needle is on it, as displays show it."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from app.files.json_file import read_json
from app.fixture import MarginState
from app.geometry import (
    FloatArray,
    FrameError,
    InputError,
    MarginGuardError,
    SurfaceMesh,
    Transform,
    anatomical_direction,
)
from app.planning import NeedlePath, guide_needle
from app.robot.primitives import cylinder
from app.runtime import SessionContent
from app.session import StepResult
from app.workflow.approach_ghost import check_setup

RANGE_MM = 12.0
"""Half of the width of the cross-hair; what is farther away is drawn at its edge."""
RINGS_MM = (2.0, 5.0, 10.0)

_MAX_BYTES = 4_000_000


@dataclass(frozen=True, slots=True, eq=False)
class PlannedNeedle:
    """The corridors of ``marginguard plan needle``, in the axes of their frame.

    ``frame_from_target`` is the pose of the target's structure for which they were planned;
    ``window_mm`` is the displacement of the target at which the needle may advance, None if the
    plan has none.
    """

    setup_id: str
    diameter_mm: float
    frame_from_target: Transform
    window_mm: float | None
    paths: tuple[NeedlePath, ...]


@dataclass(frozen=True, slots=True)
class NeedleShown:
    """Guidance in words. ``problem``: why the place of the needle is not known, empty if it is.

    ``tip`` and ``axis`` are x (right) and y (down) in mm as seen along the corridor: the tip, and
    where the needle's axis meets the plane of the entry; None with a problem. ``letters``:
    directions of the patient at the right, lower, left and upper end. ``gate``: ``open``,
    ``closed``, or empty without a window; ``gate_text`` says why.
    """

    corridor: int
    corridors: tuple[str, ...]
    problem: str = ""
    lateral: str = ""
    angle: str = ""
    remaining: str = ""
    miss: str = ""
    tip: tuple[float, float] | None = None
    axis: tuple[float, float] | None = None
    letters: tuple[str, ...] = ()
    gate: str = ""
    gate_text: str = ""


class NeedleGuide:
    """The chosen corridor of a plan, and the guarded tool on it as its needle.

    The tip of the tool is that of the needle, along the tool's z axis. Call it in the display's
    thread.
    """

    def __init__(self) -> None:
        self._plan: PlannedNeedle | None = None
        self._corridor = 0
        self._surface: SurfaceMesh | None = None
        self._compared: tuple[PlannedNeedle | None, SessionContent | None] = None, None
        self._refused = ""
        self._shown: NeedleShown | None = None
        self.revision = 0
        """Changes when a display has to be updated without a step."""

    @property
    def has_plan(self) -> bool:
        """True if a plan is in use."""
        return self._plan is not None

    @property
    def surface(self) -> SurfaceMesh | None:
        """The corridor with the needle's diameter, in its frame; None where none is to be drawn."""
        return None if self._refused else self._surface

    def read(self, path: Path) -> None:
        """Use the best corridor of a file. Raises `InputError` for a file that is no plan."""
        self._plan = read_needle_plan(path)
        self.choose(0)

    def remove(self) -> None:
        """Show no corridor."""
        self._plan = self._surface = self._shown = None
        self.revision += 1

    def choose(self, corridor: int) -> None:
        """Use the corridor of this number, 0 for the best. Raises `InputError` without it."""
        plan = self._plan
        if plan is None or not 0 <= corridor < len(plan.paths):
            count = 0 if plan is None else len(plan.paths)
            raise InputError(f"corridor: is {corridor}; expected one of {count}, counted from 0")
        self._corridor = corridor
        self._surface = _surface(plan.paths[corridor], plan.diameter_mm)
        self.revision += 1

    def update(self, step: StepResult, content: SessionContent, silent: str) -> None:
        """Guide the needle at ``step``; ``silent``: why the step is not the present, or empty."""
        plan = self._plan
        if plan is None:
            self._shown, self._refused = None, ""
            return
        if self._compared != (plan, content):
            self._compared = plan, content
            try:
                check_setup(plan.setup_id, content)
                self._refused = ""
            except InputError as error:
                self._refused = str(error)
        problem = self._refused or silent or step.distrust
        self._shown = _guidance(plan, self._corridor, step, content, problem)

    def shown(self) -> NeedleShown | None:
        """Guidance at the last `update`; None without a plan."""
        return self._shown


def read_needle_plan(path: Path) -> PlannedNeedle:
    """Read the JSON of ``marginguard plan needle``. Raises `InputError` for the first fault."""
    values = read_json(path, _MAX_BYTES)
    try:
        return _plan(values)
    except (KeyError, TypeError, ValueError, OverflowError, MarginGuardError) as error:
        raise InputError(
            f"{path}: is not a plan ({type(error).__name__}: {error}); expected the JSON of "
            "'marginguard plan needle'"
        ) from error


def _plan(values: Any) -> PlannedNeedle:
    frame, target, setup_id = (values[name] for name in ("frame", "target", "setup_id"))
    if not all(isinstance(each, str) and each for each in (frame, target, setup_id)):
        raise TypeError("frame, target and setup_id are no texts")
    window_mm = values["window_mm"]
    diameter_mm = float(values["needle"]["diameter_mm"])
    if not 0.0 < diameter_mm < math.inf:
        raise ValueError(f"the diameter is {diameter_mm} mm")
    if window_mm is not None and not 0.0 <= float(window_mm) < math.inf:
        raise ValueError(f"the window is {window_mm} mm")
    pose = Transform.from_matrix(
        np.array(values["frame_from_target"], dtype=np.float64), target=frame, source=target
    )
    paths = tuple(
        NeedlePath(frame, each["entry_mm"], each["target_mm"]) for each in values["corridors"]
    )
    if not paths:
        raise ValueError("it has no corridors")
    return PlannedNeedle(
        setup_id, diameter_mm, pose, None if window_mm is None else float(window_mm), paths
    )


def _guidance(
    plan: PlannedNeedle, corridor: int, step: StepResult, content: SessionContent, problem: str
) -> NeedleShown:
    path = plan.paths[corridor]
    names = tuple(f"{n + 1}: {each.depth_mm:.0f} mm deep" for n, each in enumerate(plan.paths))
    if problem:
        return NeedleShown(corridor, names, problem)
    try:
        pose = step.edges.between(path.frame, content.tip_frame)[0]
        tip, _ = path.path_from_needle(pose)
        found = guide_needle(path, pose)
        tumor_from_path = step.edges.between(content.tumor.frame, path.frame)[0]
    except (FrameError, InputError) as error:
        return NeedleShown(corridor, names, str(error))
    axes = tumor_from_path.rotation @ path.frame_from_path.rotation
    ends = axes[:, 0], axes[:, 1], -axes[:, 0], -axes[:, 1]
    gate, gate_text = _gate(plan, path, step)
    return NeedleShown(
        corridor,
        names,
        lateral=f"{found.lateral_mm:.1f} mm",
        angle=f"{math.degrees(found.angle_rad):.1f}\N{DEGREE SIGN}",
        remaining=_depth(found.remaining_mm),
        miss=f"{found.miss_mm:.1f} mm",
        tip=_pair(tip),
        axis=_pair(found.crosshair_mm),
        letters=tuple(map(anatomical_direction, ends)),
        gate=gate,
        gate_text=gate_text,
    )


def _depth(remaining_mm: float) -> str:
    return f"{remaining_mm:.1f} mm" if remaining_mm >= 0.0 else f"{-remaining_mm:.1f} mm beyond"


def _gate(plan: PlannedNeedle, path: NeedlePath, step: StepResult) -> tuple[str, str]:
    """The gate of the breath, and the reason for its state."""
    window_mm = plan.window_mm
    if window_mm is None:
        return "", ""
    decision = step.decision
    if decision.hold or decision.state is MarginState.POSITIVE:
        return "closed", "the guard is on hold" if decision.hold else "the margin is POSITIVE"
    planned = plan.frame_from_target
    try:
        now = step.edges.between(planned.target, planned.source)[0]
    except FrameError as error:
        return "closed", f"place of the target: {error}"
    target_mm = (now @ planned.inverse()).apply(path.target_mm)
    away_mm = float(np.linalg.norm(target_mm - path.target_mm))
    text = f"target {away_mm:.1f} mm from its planned place, window {window_mm:g} mm"
    return ("open" if path.is_target_near(target_mm, window_mm) else "closed"), text


def _pair(point_mm: FloatArray) -> tuple[float, float]:
    x, y = np.clip(point_mm[:2], -RANGE_MM, RANGE_MM).round(2).tolist()
    return x, y


def _surface(path: NeedlePath, diameter_mm: float) -> SurfaceMesh:
    """The cylinder around the axis of ``path`` from entry to target, in its frame."""
    vertices, faces = cylinder(diameter_mm / 2.0, path.depth_mm)
    middle = np.array([0.0, 0.0, path.depth_mm / 2.0])
    return SurfaceMesh(
        path.frame, path.frame_from_path.apply(vertices + middle), faces.astype(np.int32)
    )
