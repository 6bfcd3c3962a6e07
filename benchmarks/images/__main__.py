"""Delay from an image's stamp to the page, beside the 3D view, and the memory of the session.

A sender publishes images of 640 x 480 at 30 per second and the poses of four sensors at 60 per
second, stamped by this machine's clock. ``marginguard view --live`` shows them, headless Chromium
opens the page at 1280x720. The page records, in each of its frames, when it shows an image for the
first time; the number drawn into it tells its stamp, which lies 6 ms before it is sent. The delay
is the time since the stamp. The pictures of the 3D view are counted in the same frames.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import sync_playwright

from app.cli.progress import announce_duration
from app.geometry import FloatArray
from benchmarks.harness.figures import figures_table, percentiles, show
from benchmarks.harness.goals import Goal, at_least, at_most, finish
from benchmarks.harness.options import BenchParser
from benchmarks.harness.processes import CLI, children
from benchmarks.images.session import image_stamp_ns, write_session
from benchmarks.ros_domain import own_ros
from benchmarks.view.chromium import SIZE, launch
from benchmarks.view.stamps import read_in_page

GOAL_MS, GOAL_PICTURES_HZ, GOAL_GROWTH_PERCENT = 150.0, 15.0, 5.0
_WARM_UP_S = 5.0
_SAMPLE_S = 5.0

IMAGE = "document.querySelector('#ultrasound > div[data-problem=false] #us-image image[href]')"
COUNT_PICTURES = """() => {
  let last = null;
  const read = () => {
    const picture = document.querySelector("main.view img")?.src;
    if (picture && picture !== last) window.shownPictures += 1;
    last = picture ?? last;
    requestAnimationFrame(read);
  };
  window.shownPictures = 0;
  read();
}"""


def figures(
    shown: FloatArray, pictures: int, memory_mb: list[float], seconds: float
) -> dict[str, Any]:
    """Figures of images (n, 2) by stamp and time in ms, and of the memory every 5 s.

    The growth of the memory and its slope (least squares) are those after the first quarter.
    """
    p50, p95, longest = percentiles(shown[:, 1] - shown[:, 0], 50, 95, 100)
    later_mb = np.array(memory_mb[len(memory_mb) // 4 :])
    minutes = np.arange(len(later_mb)) * _SAMPLE_S / 60.0
    return {
        "seconds": seconds, "images": len(shown), "images_hz": len(shown) / seconds,
        "delay_p50_ms": p50, "delay_p95_ms": p95, "delay_max_ms": longest,
        "pictures_hz": pictures / seconds, "memory_mb": memory_mb,
        "growth": max(memory_mb[-2:]) / float(later_mb[0]) - 1.0,
        "slope_mb_per_min": float(np.polyfit(minutes, later_mb, 1)[0]) if len(minutes) > 1 else 0.0,
    }  # fmt: skip


def goals(found: Mapping[str, Any]) -> Iterator[Goal]:
    growth = 100.0 * found["growth"]
    yield at_most("p95 is", found["delay_p95_ms"], GOAL_MS, "ms", ".0f")
    yield at_least("there are", found["pictures_hz"], GOAL_PICTURES_HZ, "pictures/s", ".1f")
    yield at_most("memory grows by", growth, GOAL_GROWTH_PERCENT, "%", ".1f")


def measure(seconds: float, folder: Path) -> dict[str, Any]:
    with children(folder) as (_, start), sync_playwright() as playwright:
        sender = start("sender", "-m", "benchmarks.images.sender", "--stamped")
        config = write_session(folder / "session")
        server = start("view", *CLI, "view", "--live", "--config", config)
        page = launch(playwright).new_page(viewport=SIZE)
        page.goto(server.line("http://", 300.0))
        page.check('input[name="mode"][value="operate"]')
        page.evaluate(read_in_page(IMAGE))
        page.evaluate(COUNT_PICTURES)
        page.wait_for_function("window.seenFrames.length > 0", timeout=60_000)
        page.wait_for_timeout(1000.0 * _WARM_UP_S)
        page.evaluate("window.seenFrames.length = 0; window.shownPictures = 0")
        memory_mb, left_s = [], seconds
        while left_s > 0.0:
            page.wait_for_timeout(1000.0 * min(left_s, _SAMPLE_S))
            left_s -= _SAMPLE_S
            memory_mb.append(server.rss_mb)
        seen: list[list[float]] = page.evaluate("window.seenFrames")
        pictures = page.evaluate("window.shownPictures")
        begin_ns = sender.expect("begin")["ns"]
    shown = [[image_stamp_ns(begin_ns, int(number)) / 1e6, ms] for number, ms in seen]
    return figures(np.array(shown), pictures, memory_mb, seconds)


def main() -> int:
    parser = BenchParser("images", __doc__)
    parser.number("--minutes", 1.0, "duration", low=0, high=600, above=True)
    options = parser.parse_args()
    seconds = 60.0 * options.minutes
    announce_duration("images on the page", seconds + 15.0)
    with own_ros() as folder:
        found = measure(seconds, folder)
    show(figures_table(found))
    return finish(options.json, found, goals(found))
