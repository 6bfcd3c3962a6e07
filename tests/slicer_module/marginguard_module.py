"""Slicer's module MarginGuard in tests: its folder on the path, a cut of the recorded case."""

import sys
from collections.abc import Callable, Iterable
from itertools import chain
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import slicer
import yaml

from app.case import TrackingFrame
from app.geometry import NS_PER_S
from tests.cut_case import recorded_frames, write_cut_case
from tests.planning.plan_files import write_approach, write_needle
from tests.shipped_case import BRIEF, DEEP, PLANNED_DROPOUTS, SHAFT
from tests.shipped_case import SHIPPED_CASE as CASE
from tests.waiting import wait_until

FOLDER = Path(__file__).resolve().parents[2] / "slicer_module" / "MarginGuard"
UI = FOLDER / "Resources" / "UI" / "MarginGuard.ui"

if str(FOLDER) not in sys.path:
    sys.path.insert(0, str(FOLDER))  # as Slicer does with --additional-module-paths

from app.runtime import prepare_case  # noqa: E402
from app.scene import SceneApplication  # noqa: E402
from app.workflow import recorded_breaches  # noqa: E402
from MarginGuardLib.logic import STATUS_NS as STATUS_NS  # noqa: E402
from MarginGuardLib.logic import PanelLogic as PanelLogic  # noqa: E402
from MarginGuardLib.panel_inputs import RecordedCase  # noqa: E402

CLEAR_S = 8.0
"""A moment with a known margin outside of the tumour."""
DWELLS_END_S = 19.0
INVALID, SILENT, *_, MISSING, _ = PLANNED_DROPOUTS
WINDOWS_S = [
    (0.0, 1.5),
    *((start_s, start_s + 0.6) for start_s in (2.3, 9.2, 11.5, 13.8, 16.1)),  # dwells
    (4.6, 6.5),
    (6.9, CLEAR_S + 0.5),
    (INVALID["start_s"] - 0.7, INVALID["end_s"] + 1.3),
    *((each["start_s"] - 0.4, each["end_s"] + 0.4) for each in (SILENT, MISSING, BRIEF, SHAFT)),
    (DEEP["start_s"] - 0.4, DEEP["end_s"] + 1.3),
    (148.8, 150.0),
]
"""Parts of the recorded case that the tests of the panel show."""


def frames_in(windows_s: Iterable[tuple[float, float]]) -> list[TrackingFrame]:
    """Frames of the recorded case in ``windows_s``, which are disjoint, each at its own time."""
    parts = (recorded_frames(low_s, high_s - low_s) for low_s, high_s in sorted(windows_s))
    return list(chain.from_iterable(parts))


def cut_case(folder: Path) -> Path:
    """Write the recorded case, registered by its dwells, with the frames of `WINDOWS_S` only."""
    dwells = yaml.safe_load((CASE / "case.yaml").read_text())["registration"]
    return write_cut_case(folder, 0.0, 0.0, lambda _: frames_in(WINDOWS_S), registration=dwells)


def open_recorded(folder: Path) -> RecordedCase:
    """The case as the panel opens it, stepped through once."""
    opened = prepare_case(folder)
    return RecordedCase(opened, recorded_breaches(opened))


def frame_times_s(recorded: RecordedCase) -> list[float]:
    """Times of the case's frames in s from the first one, those of silences included."""
    opened = recorded.case
    return [(frame.stamp.ns - opened.extent.first_ns) / NS_PER_S for frame in opened.case.frames()]


def spin_until(panel_logic: Any, is_expected: Callable[[Any], Any]) -> Any:
    """Spin the logic until ``is_expected(status)`` is true; return that status."""
    statuses = [panel_logic.refresh()]

    def spin() -> None:
        statuses[:] = [panel_logic.refresh(0.005)]

    wait_until(lambda: is_expected(statuses[0]), spin, describe=lambda: statuses[0])
    return statuses[0]


def show(panel_logic: Any, seconds: float) -> Any:
    """Seek to ``seconds`` and return the status that shows the first frame from there on."""
    panel_logic.seek(seconds)
    return spin_until(panel_logic, lambda now: seconds <= now.position_s < seconds + 0.06)


def step(panel_logic: Any) -> Any:
    """Show the next frame; return its status."""
    before = panel_logic.refresh().position_s
    panel_logic.step()
    return spin_until(panel_logic, lambda now: now.position_s > before)


def write_plans(folder: Path, session: Any) -> tuple[Path, Path]:
    """Plans in files for ``session``: an approach, and a needle.

    The tip is 5 mm beside the corridors and 20 mm before their target, along them.
    """
    content, step = session.started().content, session.shown_step
    robot = content.robot.robot
    tip = step.edges.between("reference", content.tip_frame)[0]
    pose = step.edges.between("reference", content.tumor.frame)[0]
    x, y, z = tip.rotation.T
    target = tip.translation_mm + 3.0 * x + 4.0 * y + 20.0 * z
    ends = [((target - depth * z).tolist(), target.tolist()) for depth in (60.0, 50.0)]
    return (
        write_approach(folder / "approach.json", robot, content.setup_id),
        write_needle(folder / "needle.json", content.setup_id, pose, *ends),
    )


def node_of(application: SceneApplication, name: str) -> Any:
    return application.scene.GetFirstNodeByName(name)


def tumor_color(application: SceneApplication) -> tuple[float, float, float]:
    return node_of(application, "Tumor").GetDisplayNode().GetColor()


def in_slicer(monkeypatch: pytest.MonkeyPatch, application: SceneApplication) -> None:
    """Set ``slicer.mrmlScene``, and ``slicer.app`` to a TEST DOUBLE."""
    monkeypatch.setattr(slicer, "mrmlScene", application.scene, raising=False)
    app = SimpleNamespace(applicationLogic=lambda: application.logic)
    monkeypatch.setattr(slicer, "app", app, raising=False)
