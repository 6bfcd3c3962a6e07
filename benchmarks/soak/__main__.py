"""Run a live session and its recorder for a long time: memory, and gaps at a receiver.

    marginguard bench soak [--minutes 60] [--page] [--json FILE]

Real processes: `marginguard live` with the shipped live.yaml sends its constraint at 1 kHz and gets
the poses of three sensors and the joints 200 times a second; `marginguard record` records both. A
receiver measures the gaps between constraints, beside those of a bare sender at 1 kHz on the same
machine. The resident memory is read every 5 s. Its slope is that of Theil and Sen (median of the
slopes of all pairs) after a warm-up of a fifth of the time. With --page, `marginguard view` plays
the shipped case beside them on a page that a headless Chromium shows.

Exit status 1 when a process ends, when the memory of the session grows by 1 MB an hour or more
(runs of at least 30 minutes), when the 99.99th percentile of the gaps is above 1.2 times the bare
sender's, or when a gap over 10 ms is longer than twice the bare sender's longest.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import theilslopes

from app.cli.progress import announce_duration
from app.files.shipped import shipped
from benchmarks.faults.child import Child
from benchmarks.faults.environment import prepare
from benchmarks.ros_domain import reserved_domain

RATE_HZ = 200
SAMPLE_S = 5.0
WARM_UP = 0.2
MAX_SLOPE_MB_H = 1.0
MIN_SLOPE_MINUTES = 30.0
MAX_GAP_MS = 10.0
MAX_P9999_RATIO, MAX_GAP_RATIO = 1.2, 2.0
GUARD, BARE = "/marginguard/constraint", "/bare/constraint"
CASE = Path("data/recorded_case")
LIVE_YAML = Path("data/live_example/live.yaml")


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="marginguard bench soak",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--minutes", type=float, default=60.0, help="how long (default: 60)")
    parser.add_argument("--page", action="store_true", help="with the web page and a browser")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there too")
    options = parser.parse_args()
    if not 0.2 <= options.minutes <= 6000.0:
        parser.error(f"--minutes is {options.minutes:g}; expected 0.2 to 6000")
    return options


def main() -> int:
    options = parsed()
    announce_duration("soak", 60.0 * options.minutes)
    with reserved_domain() as domain, tempfile.TemporaryDirectory() as name:
        prepare(domain, Path(name))
        found = soak(Path(name), 60.0 * options.minutes, options.json, page=options.page)
    for key, value in found.items():
        print(f"{key:<28} {value}")
    return 1 if found["failures"] else 0


def soak(folder: Path, seconds: float, path: Path | None, *, page: bool) -> dict[str, Any]:
    """Start the processes, sample them for ``seconds``, and return the figures."""
    from benchmarks.faults.scene import write_scene

    scene = folder / "scene.json"
    write_scene(scene, time.time_ns())
    interpolate(scene, RATE_HZ)
    root = shipped()
    children: dict[str, Child] = {}

    def start(name: str, *arguments: str) -> Child:
        children[name] = Child(name, arguments, folder / f"{name}.log")
        return children[name]

    rows: list[dict[str, float]] = []
    topics: dict[str, dict[str, float]] = {}
    try:
        start("tracker", str(root / "benchmarks/faults/tracker_peer.py"), str(scene))
        receiver = start("receiver", "-m", "benchmarks.soak.receiver")
        receiver.expect("ready")
        live = start("live", "-m", "app.cli", "live", "--config", str(root / LIVE_YAML))
        if page:
            view = start("view", "-m", "app.cli", "view", str(root / CASE))
            start("browser", "-m", "benchmarks.soak.browser", wait_for_url(view)).expect("ready")
        case = str(folder / "case")
        start("record", "-m", "app.cli", "record", "-o", case)
        start("bare", "-m", "benchmarks.soak.sender", str(seconds + 600.0))
        wait_for_constraints(receiver, live)
        receiver.send(do="restart")
        receiver.expect("figures")
        begin_s = time.monotonic()
        while (passed_s := time.monotonic() - begin_s) < seconds:
            rows.append({"s": passed_s, **{n: rss_mb(c) for n, c in children.items()}})
            receiver.send(do="figures")
            topics = receiver.expect("figures")["topics"]
            if path is not None:
                write(path, figures(rows, topics))
            time.sleep(min(SAMPLE_S, seconds - passed_s))
    finally:
        ended = [name for name, child in children.items() if not child.running]
        for child in children.values():
            child.end()
    found = figures(rows, topics)
    found["failures"] += [f"{name} has ended" for name in ended]
    if path is not None:
        write(path, found)
    return found


def write(path: Path, found: dict[str, Any]) -> None:
    """Write the figures so far: a run of an hour may be interrupted."""
    path.write_text(json.dumps(found, indent=1) + "\n")


def wait_for_constraints(receiver: Child, live: Child) -> None:
    """Wait until constraints of the session and of the bare sender arrive."""
    while True:
        receiver.send(do="figures")
        topics = receiver.expect("figures")["topics"]
        if all(topics[topic]["received"] for topic in (GUARD, BARE)):
            return
        if not live.running:
            raise RuntimeError(f"the session has ended: {live.tail()}")
        time.sleep(0.5)


def wait_for_url(view: Child) -> str:
    """Wait for the URL that opens the page with its controls."""
    while True:
        for line in list(view.lines):
            if line.startswith("http://"):
                return line
        if not view.running:
            raise RuntimeError(f"the page has ended: {view.tail()}")
        time.sleep(0.1)


def rss_mb(child: Child) -> float:
    """Resident memory of a process in MB; 0 if it has ended."""
    try:
        pages = int(Path(f"/proc/{child.process.pid}/statm").read_text().split()[1])
    except OSError:
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def figures(rows: list[dict[str, float]], topics: dict[str, dict[str, float]]) -> dict[str, Any]:
    """Memory of session and recorder, gaps at the receiver, and missed requirements."""
    steady = [row for row in rows if row["s"] >= WARM_UP * rows[-1]["s"]]
    found: dict[str, Any] = {"minutes": round(rows[-1]["s"] / 60.0, 1)}
    for name in ("live", "record"):
        found[f"{name}: MB"] = f"{steady[0][name]:.1f} to {steady[-1][name]:.1f}"
        found[f"{name}: MB/h"] = slope_mb_h(steady, name)
    for topic in (GUARD, BARE):
        found[topic] = topics.get(topic, {})
    found["load"] = os.getloadavg()[2]
    found["failures"] = failures(found)
    found["samples"] = len(rows)
    return found


def slope_mb_h(rows: list[dict[str, float]], name: str) -> float | None:
    """Slope by Theil and Sen in MB/h; None for fewer than three samples."""
    if len(rows) < 3:
        return None
    slope = theilslopes([row[name] for row in rows], [row["s"] / 3600.0 for row in rows])[0]
    return round(float(slope), 3)


def failures(found: dict[str, Any]) -> list[str]:
    """Missed requirements, one sentence each."""
    wrong = []
    slope = found["live: MB/h"]
    if found["minutes"] >= MIN_SLOPE_MINUTES and not (slope is not None and slope < MAX_SLOPE_MB_H):
        wrong.append(f"the session grows by {slope} MB/h; expected less than {MAX_SLOPE_MB_H:g}")
    guard, bare = found[GUARD], found[BARE]
    if not guard or not bare:
        return wrong
    allowed_ms = MAX_P9999_RATIO * bare["p9999_gap_ms"]
    if guard["p9999_gap_ms"] > allowed_ms:
        wrong.append(
            f"99.99 % of the gaps are up to {guard['p9999_gap_ms']:.2f} ms; expected at most "
            f"{allowed_ms:.2f} ms, {MAX_P9999_RATIO:g} times the bare sender's"
        )
    allowed_ms = max(MAX_GAP_MS, MAX_GAP_RATIO * bare["max_gap_ms"])
    if guard["max_gap_ms"] > allowed_ms:
        wrong.append(
            f"a gap of {guard['max_gap_ms']:.1f} ms; expected at most {MAX_GAP_MS:g} ms, or "
            f"{MAX_GAP_RATIO:g} times the bare sender's {bare['max_gap_ms']:.1f} ms"
        )
    return wrong


def interpolate(path: Path, rate_hz: int) -> None:
    """Raise the rate of a written scene to ``rate_hz`` by linear interpolation."""
    scene = json.loads(path.read_text())
    frames = scene["frames"]
    factor = round(rate_hz * scene["period_ns"] / 1e9)
    dense = [
        between(frame, after, part / factor)
        for frame, after in pairwise(frames)
        for part in range(factor)
    ]
    scene["frames"], scene["period_ns"] = dense, scene["period_ns"] // factor
    path.write_text(json.dumps(scene))


def between(frame: dict[str, Any], after: dict[str, Any], part: float) -> dict[str, Any]:
    """Frame between two; quaternions of neighbours are close, so they are interpolated linearly."""
    edges = []
    for one, other in zip(frame["edges"], after["edges"], strict=True):
        first, second = np.array(one), np.array(other)
        if first[3:] @ second[3:] < 0.0:
            second[3:] *= -1.0
        pose = (1.0 - part) * first + part * second
        pose[3:] /= np.linalg.norm(pose[3:])
        edges.append(pose.tolist())
    joints = (1.0 - part) * np.array(frame["joints"]) + part * np.array(after["joints"])
    return {**frame, "edges": edges, "joints": joints.tolist()}


if __name__ == "__main__":
    sys.exit(main())
