"""Cases: the shipped one, opening, replaying, making and writing, also as a scene of 3D Slicer."""

import math
import os
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from numbers import Real
from pathlib import Path
from typing import Literal

from app import case as cases
from app.files.paths import PROJECT_DATA, input_path
from app.fixture import MarginParameters
from app.geometry import NS_PER_S, InputError, Stamp, SurfaceMesh, TrackedTransform, Transform
from app.runtime import PreparedCase, ReplayRun, prepare_case
from app.session import StepResult
from marginguard.values import (
    as_path,
    checked,
    checked_iterable,
    checked_list,
    described,
    needs,
)

__all__ = [
    "PreparedCase",
    "StepResult",
    "example_case",
    "make_case",
    "open_case",
    "replay",
    "save_scene",
    "write_case",
]


def example_case() -> Path:
    """Folder of the shipped case: a simulated lumpectomy with three breaches.

    >>> import marginguard as mg
    >>> (mg.example_case() / "case.yaml").is_file()
    True
    """
    return PROJECT_DATA / "recorded_case"


def open_case(
    folder: str | os.PathLike[str],
    *,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
    tip_only: bool = False,
    tool: str | None = None,
) -> PreparedCase:
    """Open the case in ``folder``, repair its tumour, estimate its clock, register its robot.

    ``folder`` may be ``package://marginguard/recorded_case``, the shipped case. The packages that
    the case names are found in ``package_dirs``. With ``tip_only`` the tool is its tip alone.
    ``tool`` names one of several tools. Takes seconds. Raises `InputError` for a case that cannot
    be used.

    >>> import marginguard as mg
    >>> case = mg.open_case("package://marginguard/recorded_case")
    >>> case.case.manifest.name, case.extent.frames
    ('simulated lumpectomy 1', 5965)
    """
    as_path(folder, "folder")
    checked_iterable(package_dirs, "package_dirs", "a sequence of paths")
    dirs = [as_path(each, f"package_dirs[{i}]") for i, each in enumerate(package_dirs)]
    return prepare_case(
        input_path(os.fspath(folder)), package_dirs=dirs, tip_only=tip_only, tool=tool
    )


def replay(
    case: PreparedCase, *, start_s: float = 0.0, end_s: float = math.inf
) -> Iterator[StepResult]:
    """Yield the step of each frame of ``case``, as fast as they are read; publishes nothing.

    ``start_s`` and ``end_s`` are seconds from the recording's first frame. A replay is a session of
    its own, without the frames before ``start_s``. Raises `InputError` for other values.

    >>> import marginguard as mg
    >>> case = mg.open_case(mg.example_case())
    >>> for step in mg.replay(case, start_s=95.0, end_s=96.5):
    ...     if step.decision.state is mg.MarginState.POSITIVE:
    ...         print(step.decision.reasons[0])
    ...         break
    contact
    """
    checked(case, PreparedCase, "case", ", as open_case returns")
    for name, value in (("start_s", start_s), ("end_s", end_s)):
        if not isinstance(value, int | float) or math.isnan(value) or value < 0.0:
            raise InputError(f"{name}: is {value!r}; expected seconds >= 0")
    run = ReplayRun(case, clock_ns=time.monotonic_ns, start_s=start_s, end_s=end_s)
    return run.steps()


def make_case(folder: str | os.PathLike[str], *, seed: int = 1) -> Path:
    """Write a simulated lumpectomy with ground truth to the new ``folder``; returns its path.

    The same ``seed`` gives the same bytes. Takes half a minute. Raises `InputError` for a folder
    that exists.

    >>> import marginguard as mg
    >>> mg.make_case(mg.example_case(), seed=7)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    app.geometry.errors.InputError: ... already exists; refusing to overwrite it
    """
    from app.synthetic import simulate_case
    from app.synthetic.motion import TouchArm

    path = as_path(folder, "folder")
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise InputError(f"seed: is {seed!r}; expected an integer of 0 or more")
    if path.exists():
        raise InputError(f"{path} already exists; refusing to overwrite it")
    command = f"marginguard make-case DIR --seed {seed}"
    simulate_case(path, seed=seed, arm=TouchArm(), command=command)
    return path


def write_case(
    folder: str | os.PathLike[str],
    poses: Iterable[tuple[float, Sequence[Transform]]],
    *,
    tool: SurfaceMesh,
    tool_from_tip: Transform,
    tumor: SurfaceMesh,
    frame_from_tumor: Transform,
    margins: MarginParameters,
    name: str,
    provenance: Literal["simulated", "recorded"],
    source: str,
    licence: str = "none",
) -> Path:
    """Write a case of your own surfaces and poses to the new ``folder``; returns its path.

    ``poses`` yields a time in s and the poses that were measured then; a pose that is missing was
    lost. The poses must connect the tool's tracked frame with the tumour's. ``tool`` is closed, in
    the frame of its tip: ``tool_tip`` for a tracked ``tool``, with ``tool_from_tip`` from the
    one to the other. ``tumor`` is closed, in the frame ``tumor``, which ``frame_from_tumor`` places
    in a tracked frame. Surfaces are written with single precision. Raises `InputError` for a folder
    that exists and for times that do not increase, `FrameError` and `MeshError` for surfaces.

    >>> import tempfile
    >>> import numpy as np, trimesh
    >>> import marginguard as mg
    >>> def ball(frame, radius_mm):
    ...     shape = trimesh.creation.icosphere(3, radius_mm)
    ...     return mg.SurfaceMesh(frame, shape.vertices, shape.faces)
    >>> def pose(target, source, z_mm):
    ...     return mg.Transform(target, source, np.eye(3), [0.0, 0.0, z_mm])
    >>> margins = mg.open_case(mg.example_case()).setup.margins
    >>> sensor = pose("tracker", "sensor", 0.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     case = mg.open_case(
    ...         mg.write_case(
    ...             f"{folder}/case",
    ...             [(0.02 * k, [sensor, pose("tracker", "tool", 30 - k)]) for k in range(9)],
    ...             tool=ball("tool_tip", 1.0),
    ...             tool_from_tip=pose("tool", "tool_tip", 0.0),
    ...             tumor=ball("tumor", 10.0),
    ...             frame_from_tumor=pose("sensor", "tumor", 0.0),
    ...             margins=margins,
    ...             name="two balls",
    ...             provenance="simulated",
    ...             source="an example",
    ...         )
    ...     )
    ...     distances = mg.margin_table(mg.replay(case))["signed_distance_mm"]
    >>> round(distances.iloc[-1])
    11
    """
    path = as_path(folder, "folder")
    checked_iterable(poses, "poses", "pairs of a time in s and its poses")
    checked(margins, MarginParameters, "margins")
    for text, what in ((name, "name"), (source, "source"), (licence, "licence")):
        checked(text, str, what)
    bodies = [
        cases.TrackedBody(checked(mesh, SurfaceMesh, what), checked(placed, Transform, where))
        for mesh, what, placed, where in (
            (tool, "tool", tool_from_tip, "tool_from_tip"),
            (tumor, "tumor", frame_from_tumor, "frame_from_tumor"),
        )
    ]
    cases.write_case(
        path,
        _frames(poses),
        name=name,
        provenance=cases.Provenance(provenance, source, licence),
        tool=bodies[0],
        tumor=bodies[1],
        margins=cases.MarginEntry(**asdict(margins)),
    )
    return path


def _frames(poses: Iterable[tuple[float, Sequence[Transform]]]) -> Iterator[cases.TrackingFrame]:
    last_ns = -1
    for index, entry in enumerate(poses):
        try:
            time_s, transforms = entry
            if isinstance(time_s, bool) or not isinstance(time_s, Real):
                raise InputError(
                    f"poses[{index}]: time is {described(time_s)}; expected a number of s"
                )
            ns = round(float(time_s) * NS_PER_S)
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError(
                f"poses[{index}]: is not a time in s and its poses; expected a pair"
            ) from error
        if ns <= last_ns:
            raise InputError(
                f"poses[{index}]: time is {time_s} s; expected more than {last_ns / NS_PER_S:g} s"
                if last_ns >= 0
                else f"poses[{index}]: time is {time_s} s; expected 0 s or more"
            )
        last_ns = ns
        stamp = Stamp(ns)
        samples = checked_list(transforms, Transform, f"poses[{index}]")
        yield cases.TrackingFrame(
            stamp, tuple(TrackedTransform.valid(sample, stamp) for sample in samples)
        )


def save_scene(
    case: PreparedCase,
    step: StepResult,
    path: str | os.PathLike[str],
    *,
    recording: Iterable[StepResult] = (),
) -> None:
    """Save ``step`` as a scene of 3D Slicer (``.mrb``), with ``recording`` for Slicer to play.

    ``step`` must place tumour and tool. Needs the extra ``scene``; draws nothing. Raises
    `InputError` without it, `SceneError` (a `MarginGuardError`) for a step without a pose and for a
    path that cannot be written.

    >>> import tempfile, zipfile
    >>> import marginguard as mg
    >>> case = mg.open_case(mg.example_case())
    >>> steps = list(mg.replay(case, start_s=95.0, end_s=96.5))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     mg.save_scene(case, steps[-1], f"{folder}/breach.mrb")
    ...     any("Tumor" in name for name in zipfile.ZipFile(f"{folder}/breach.mrb").namelist())
    True
    """
    checked(case, PreparedCase, "case", ", as open_case returns")
    checked(step, StepResult, "step", ", as replay yields")
    steps = checked_list(recording, StepResult, "recording", ", as replay yields")
    target = as_path(path, "path")
    with needs("the scene of 3D Slicer"):
        from app.scene import StepScene, add_sequences, save_scene
    shown = StepScene(case.content, step)
    if steps:
        frames = [each.frame.poses for each in steps if each.frame.poses]
        states = [
            (each.frame.stamp.ns, each.decision.state, each.decision.reasons) for each in steps
        ]
        add_sequences(shown.scene, frames, states, step.frame.stamp.ns)
    save_scene(shown.application.scene, target)
