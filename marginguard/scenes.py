"""Scenes of 3D Slicer."""

import os
from collections.abc import Iterable

from app.runtime import PreparedCase
from app.session import StepResult
from marginguard.arguments import as_path, checked, checked_list, needs

__all__ = ["save_scene"]


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
