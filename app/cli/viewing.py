"""Puts a page together: the steps of a case or of a live session, and a stage for them."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.cli.progress import with_progress

if TYPE_CHECKING:
    from app.case import Case
    from app.session import SessionSetup
    from app.viewer import Cast, Title, Viewer


def replay_viewer(folder: Path, package_dirs: Sequence[Path], *, tip_only: bool) -> "Viewer":
    """A page for a recorded case, all of which is stepped through first."""
    from app.case import open_case
    from app.report import ReplayLog, find_breaches
    from app.session import Session, setup_from_case, with_estimated_clock, with_repaired_tumor
    from app.viewer import ReplayFeed, ReplayTimeline, Stage, Viewer, Watcher

    opened = open_case(folder, package_dirs=package_dirs)
    case, _ = with_estimated_clock(with_repaired_tumor(opened))
    setup = setup_from_case(case, tip_only=tip_only)
    session, watcher, log = Session(setup), Watcher(setup), ReplayLog()
    shown = []
    for frame in with_progress(case.frames(), "stepping through frame"):
        began_ns = time.perf_counter_ns()
        step = session.step(frame)
        log.add(step, time.perf_counter_ns() - began_ns)
        shown.append(watcher.see(step))
    feed = ReplayFeed(shown, time.monotonic_ns)
    breaches = find_breaches(log.rows, setup.margins.stale_after_ns)
    timeline = ReplayTimeline(feed, [(breach.first, breach.last) for breach in breaches])
    stage = Stage(cast_of(case, setup, tip_only=tip_only))
    return Viewer(stage, feed, timeline, title_of(case, setup, live=False), feed.control)


def cast_of(case: "Case", setup: "SessionSetup", *, tip_only: bool) -> "Cast":
    """What stands on the stage."""
    from app.fixture import margin_surface
    from app.viewer import Cast

    tumor, robot = case.tumor_mesh(), setup.robot
    return Cast(
        tumor=tumor,
        margin=margin_surface(tumor, setup.margins.stop_mm) if setup.margins.stop_mm else None,
        tool=None if tip_only else case.tool_mesh(),
        tip_frame=case.manifest.tool.tip_frame,
        fixed=setup.static_edges,
        robot=None if robot is None else robot.robot,
        base_frame="" if robot is None else robot.base_frame,
        tool_link="" if robot is None else robot.tool_link,
    )


def title_of(case: "Case", setup: "SessionSetup", *, live: bool) -> "Title":
    """What the page says of the case."""
    from app.viewer import Title

    return Title(case=case.manifest.name, live=live, registration=_registration(setup))


def _registration(setup: "SessionSetup") -> dict[str, Any]:
    """The verdict on the registration, in a word and in numbers."""
    robot = setup.robot
    if robot is None:
        return {"ok": True, "word": "no robot", "numbers": {}}
    result = robot.registration
    if result is None:
        return {"ok": False, "word": "missing", "numbers": {}}
    numbers = {"Points": str(len(result.used))} if len(result.residuals_mm) else {}
    if result.fre_mm is not None:
        numbers["FRE"] = f"{result.fre_mm:.2f} mm"
    if result.covariance is None:
        numbers["Error at the tip"] = "not known: it was given"
    return {
        "ok": result.accepted,
        "word": "accepted" if result.accepted else "refused",
        "numbers": numbers,
    }
