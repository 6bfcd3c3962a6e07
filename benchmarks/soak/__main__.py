"""Run a live session and its recorder for a long time: memory, and gaps at a receiver.

Real processes: `marginguard live` with the shipped live.yaml sends its constraint at 1 kHz and gets
the poses of three sensors and the joints 200 times a second; `marginguard record` records both. A
receiver measures the gaps between constraints, beside those of a bare sender at 1 kHz on the same
machine. The resident memory is read every 5 s. Its slope is that of Theil and Sen (median of the
slopes of all pairs) after a warm-up of a fifth of the time. With --page, `marginguard view` plays
the shipped case beside them on a page that a headless Chromium shows.
"""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from scipy.stats import theilslopes

from app.cli.progress import announce_duration
from app.files.paths import shipped
from benchmarks.faults.scene import tracker_arguments
from benchmarks.harness.figures import figures_table, load, show, write_json
from benchmarks.harness.goals import Goal, at_most, finish
from benchmarks.harness.options import RECORDED_CASE, BenchParser
from benchmarks.harness.processes import CLI, Child, children
from benchmarks.ros_domain import own_ros
from benchmarks.soak.processes import BARE, GUARD

RATE_HZ = 200
SAMPLE_S = 5.0
WARM_UP = 0.2
MAX_SLOPE_MB_H = 1.0
MIN_SLOPE_MINUTES = 30.0
MAX_GAP_MS = 10.0
MAX_P9999_RATIO, MAX_GAP_RATIO = 1.2, 2.0
PROCESSES = ("-m", "benchmarks.soak.processes")


def main() -> int:
    parser = BenchParser("soak", __doc__)
    parser.number("--minutes", 60.0, "how long", low=0.2, high=6000.0)
    parser.add_argument("--page", action="store_true", help="with the web page and a browser")
    options = parser.parse_args()
    announce_duration("soak", 60.0 * options.minutes)
    with own_ros() as folder:
        found, ended = soak(folder, 60.0 * options.minutes, options.json, page=options.page)
    show(figures_table(found))
    return finish(options.json, found, [*goals(found), *ended])


def soak(
    folder: Path, seconds: float, path: Path | None, *, page: bool
) -> tuple[dict[str, Any], list[Goal]]:
    """Start the processes, sample them for ``seconds``; the figures, and a goal for a lost one.

    The file is written at each sample: a run of an hour may be interrupted.
    """
    rows: list[dict[str, float]] = []
    topics: dict[str, dict[str, float]] = {}
    with children(folder) as (running, start):
        start("tracker", *tracker_arguments(folder, RATE_HZ))
        receiver = start("receiver", *PROCESSES, "receiver")
        receiver.expect("ready", 60.0)
        config = shipped("data", "live_example", "live.yaml")
        live = start("live", *CLI, "live", "--config", config)
        if page:
            url = start("view", *CLI, "view", RECORDED_CASE).line("http://", 300.0)
            start("browser", *PROCESSES, "browser", url).expect("ready", 60.0)
        start("record", *CLI, "record", "-o", folder / "case")
        start("bare", *PROCESSES, "sender", seconds + 600.0)
        wait_for_constraints(receiver, live)
        receiver.send(do="restart")
        receiver.expect("figures")
        begin_s = time.monotonic()
        while (passed_s := time.monotonic() - begin_s) < seconds:
            rows.append({"s": passed_s, **{n: each.rss_mb for n, each in running.items()}})
            receiver.send(do="figures")
            topics = receiver.expect("figures")["topics"]
            write_json(path, figures(rows, topics))
            time.sleep(min(SAMPLE_S, seconds - passed_s))
        ended = [name for name, child in running.items() if not child.running]
    return figures(rows, topics), [Goal(name, "has ended", False, "running") for name in ended]


def wait_for_constraints(receiver: Child, live: Child) -> None:
    while True:
        receiver.send(do="figures")
        topics = receiver.expect("figures")["topics"]
        if all(topics[topic]["received"] for topic in (GUARD, BARE)):
            return
        if not live.running:
            raise RuntimeError(f"the session has ended: {live.tail()}")
        time.sleep(0.5)


def figures(rows: list[dict[str, float]], topics: dict[str, dict[str, float]]) -> dict[str, Any]:
    """Memory of session and recorder, and gaps at the receiver."""
    steady = [row for row in rows if row["s"] >= WARM_UP * rows[-1]["s"]]
    found: dict[str, Any] = {"minutes": round(rows[-1]["s"] / 60.0, 1)}
    for name in ("live", "record"):
        found[f"{name}: MB"] = f"{steady[0][name]:.1f} to {steady[-1][name]:.1f}"
        found[f"{name}: MB/h"] = slope_mb_h(steady, name)
    for topic in (GUARD, BARE):
        found[topic] = topics.get(topic, {})
    found["load"], found["samples"] = load(2), len(rows)
    return found


def slope_mb_h(rows: list[dict[str, float]], name: str) -> float | None:
    """Slope by Theil and Sen in MB/h; None for fewer than three samples."""
    if len(rows) < 3:
        return None
    slope = theilslopes([row[name] for row in rows], [row["s"] / 3600.0 for row in rows])[0]
    return round(float(slope), 3)


def goals(found: dict[str, Any]) -> Iterator[Goal]:
    slope, guard, bare = found["live: MB/h"], found[GUARD], found[BARE]
    long = found["minutes"] >= MIN_SLOPE_MINUTES
    grows = long and not (slope is not None and slope < MAX_SLOPE_MB_H)
    yield Goal("the session grows by", f"{slope} MB/h", not grows, f"less than {MAX_SLOPE_MB_H:g}")
    if guard and bare:
        limit_ms = MAX_P9999_RATIO * bare["p9999_gap_ms"]
        gap_ms = max(MAX_GAP_MS, MAX_GAP_RATIO * bare["max_gap_ms"])
        what = "99.99 % of the gaps are up to"
        yield at_most(what, guard["p9999_gap_ms"], limit_ms, "ms", ".2f")
        yield at_most("a gap of", guard["max_gap_ms"], gap_ms, "ms", ".1f")
