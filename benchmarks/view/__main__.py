"""Frame rate in the browser, and delay from a pose to its pixels.

    marginguard bench view [--seconds 60] [--case CASE] [--json FILE]

A separate server replays a recorded case in real time, and headless Chromium shows the page at
1280x720 (the view in it is smaller). Every picture carries the number of its frame as black and
white squares, drawn into the pixels before they are encoded. The page reads them back in each of
its own frames, just before they are shown, and records the time. The delay is the time since the
frame was due, when a tracker would have sent it. Both clocks are the machine's. For comparison the
same page runs with trame-slicer's default schedule. Exit status 1 when ours has fewer than 10
pictures a second, a 95th percentile above 250 ms, or a growing delay.
"""

import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

from app.cli.progress import announce_duration
from benchmarks.harness.figures import finish, machine, show, table
from benchmarks.harness.options import BenchParser
from benchmarks.harness.processes import children
from benchmarks.view.chromium import SIZE, launch
from benchmarks.view.results import ViewFigures, failures, figures, ratios
from benchmarks.view.stamps import READ_IN_PAGE


def watch(browser: Browser, case: Path, schedule: str, seconds: float) -> ViewFigures:
    with tempfile.TemporaryDirectory() as folder, children(Path(folder)) as (_, start):
        server = start("server", "-m", "benchmarks.view.server", schedule, case)
        page = browser.new_page(viewport=SIZE)
        page.goto(server.line("http://", 300.0))
        page.wait_for_selector("body:not([data-lost]) #state-label")
        page.evaluate(READ_IN_PAGE)
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
    rows = [
        (name, *map(str, (one.per_s, one.delay_p50_ms, one.delay_p95_ms, one.delay_max_ms,
                          one.growth_ms)))
        for name, one in (("marginguard", ours), ("trame-slicer's default", peer))
    ]  # fmt: skip
    headings = ("", "pictures/s", "p50 ms", "p95 ms", "max ms", "growth ms")
    over, this = ratios(ours, peer), machine()
    show(table("", headings, rows), f"ours over the default: {over}; load {this['load']}")
    found = {
        "ours": asdict(ours),
        "peer": asdict(peer),
        "ours_over_peer": over,
        "processors": this["cores"],
        "load_average": this["load"],
    }
    return finish(options.json, found, failures(ours))


if __name__ == "__main__":
    sys.exit(main())
