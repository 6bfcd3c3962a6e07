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

import json
import os
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

from app.cli.progress import announce_duration
from benchmarks.case_options import case_options
from benchmarks.view.chromium import launch
from benchmarks.view.results import ViewFigures, failures, figures, ratios
from benchmarks.view.stamps import READ_IN_PAGE

SIZE = {"width": 1280, "height": 720}


def watch(browser: Browser, case: Path, schedule: str, seconds: float) -> ViewFigures:
    """Figures of a page that shows ``seconds`` of the case."""
    command = [sys.executable, "-m", "benchmarks.view.server", str(case), "--schedule", schedule]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as server:
        assert server.stdin is not None
        assert server.stdout is not None
        try:
            page = browser.new_page(viewport=SIZE)
            page.goto(server.stdout.readline().strip())
            page.wait_for_selector("body:not([data-lost]) #state-label")
            page.evaluate(READ_IN_PAGE)
            page.wait_for_function("window.seenFrames.length > 0")
            page.evaluate("window.seenFrames.length = 0")
            server.stdin.write("play\n")
            server.stdin.flush()
            due_ms: list[float] = json.loads(server.stdout.readline())
            page.wait_for_timeout(1000.0 * seconds)
            seen: list[list[float]] = page.evaluate("window.seenFrames")
            page.close()
            server.stdin.close()
            server.wait(timeout=20.0)
        finally:
            server.kill()
    return figures(seen, due_ms, seconds)


def main() -> int:
    options = case_options("view", __doc__)
    with sync_playwright() as playwright:
        browser = launch(playwright)
        announce_duration("showing two pages", 2.0 * options.seconds)
        ours, peer = (
            watch(browser, options.case, schedule, options.seconds)
            for schedule in ("ours", "default")
        )
        browser.close()
    print(f"{'':<24}{'pictures/s':>11}{'p50 ms':>9}{'p95 ms':>9}{'max ms':>9}{'growth ms':>11}")
    for name, one in (("marginguard", ours), ("trame-slicer's default", peer)):
        print(
            f"{name:<24}{one.per_s:>11}{one.delay_p50_ms:>9}{one.delay_p95_ms:>9}"
            f"{one.delay_max_ms:>9}{one.growth_ms:>11}"
        )
    found = {
        "ours": asdict(ours),
        "peer": asdict(peer),
        "ours_over_peer": ratios(ours, peer),
        "processors": os.cpu_count(),
        "load_average": round(os.getloadavg()[0], 2),
        "failures": failures(ours),
    }
    print(f"ours over the default: {found['ours_over_peer']}; load {found['load_average']}")
    if options.json is not None:
        options.json.write_text(json.dumps(found, indent=1) + "\n")
    for sentence in failures(ours):
        print(sentence, file=sys.stderr)
    return 1 if failures(ours) else 0


if __name__ == "__main__":
    sys.exit(main())
