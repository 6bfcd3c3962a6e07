"""Frame rate in the browser, and delay from a pose to its pixels.

A separate server replays a recorded case in real time, and headless Chromium shows the page at
1280x720 (the view in it is smaller). Every picture carries the number of its frame as black and
white squares, drawn into the pixels before they are encoded. The page reads them back in each of
its own frames, just before they are shown, and records the time. The delay is the time since the
frame was due, when a tracker would have sent it. Both clocks are the machine's. For comparison the
same page runs with trame-slicer's default schedule.
"""

import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Browser, sync_playwright

from app.cli.progress import announce_duration
from benchmarks.harness.figures import figures_table, percentiles, show
from benchmarks.harness.goals import Goal, at_least, at_most, finish
from benchmarks.harness.options import BenchParser
from benchmarks.harness.processes import children
from benchmarks.view.chromium import SIZE, launch
from benchmarks.view.stamps import read_in_page

MIN_PER_S = 10.0
MAX_P95_MS = 250.0
MAX_GROWTH_MS = 50.0  # of the delay from the first to the last quarter: less than one picture


def figures(seen: list[list[float]], due_ms: list[float], seconds: float) -> dict[str, Any]:
    """Figures of ``[frame, time in ms]`` per picture, given the due time of each frame.

    ``growth_ms``: median delay of the last quarter minus that of the first.
    """
    frames, at_ms = np.array(seen).T
    delays = at_ms - np.array(due_ms)[frames.astype(int)]
    p50, p95, largest = (round(each, 1) for each in percentiles(delays, 50, 95, 100))
    quarter = max(len(delays) // 4, 1)
    return {
        "seconds": seconds, "pictures": len(frames), "per_s": round(len(frames) / seconds, 2),
        "delay_p50_ms": p50, "delay_p95_ms": p95, "delay_max_ms": largest,
        "longest_gap_ms": round(float(np.diff(at_ms).max(initial=0.0)), 1),
        "growth_ms": round(float(np.median(delays[-quarter:]) - np.median(delays[:quarter])), 1),
    }  # fmt: skip


def goals(ours: Mapping[str, Any]) -> Iterator[Goal]:
    yield at_least("there are", ours["per_s"], MIN_PER_S, "pictures a second")
    yield at_most("p95 of the delay is", ours["delay_p95_ms"], MAX_P95_MS, "ms")
    yield at_most("the delay grew by", ours["growth_ms"], MAX_GROWTH_MS, "ms")


def watch(browser: Browser, case: Path, schedule: str, seconds: float) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder, children(Path(folder)) as (_, start):
        server = start("server", "-m", "benchmarks.view.server", schedule, case)
        page = browser.new_page(viewport=SIZE)
        page.goto(server.line("http://", 300.0))
        page.wait_for_selector("body:not([data-lost]) #state-label")
        page.evaluate(read_in_page('document.querySelector("main.view img")'))
        page.wait_for_function("window.seenFrames.length > 0")
        page.evaluate("window.seenFrames.length = 0")
        server.send(do="play")
        due_ms: list[float] = server.expect("due")["ms"]
        page.wait_for_timeout(1000.0 * seconds)
        seen: list[list[float]] = page.evaluate("window.seenFrames")
        page.close()
    return figures(seen, due_ms, seconds)


def main() -> int:
    parser = BenchParser("view", __doc__)
    parser.number("--seconds", 60.0, "how long")
    parser.case()
    options = parser.parse_args()
    with sync_playwright() as playwright:
        browser = launch(playwright)
        announce_duration("showing two pages", 2.0 * options.seconds)
        ours, peer = (
            watch(browser, options.case, schedule, options.seconds)
            for schedule in ("ours", "default")
        )
        browser.close()
    over = {
        key.removesuffix("_ms"): round(ours[key] / peer[key], 2)
        for key in ("per_s", "delay_p50_ms", "delay_p95_ms")
    }
    found = {"ours": ours, "peer": peer, "ours_over_peer": over}
    show(figures_table(found))
    return finish(options.json, found, goals(ours))
