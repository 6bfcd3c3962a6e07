"""Process of `benchmarks.soak` that shows the page of a replay in headless Chromium.

    browser.py URL

Plays the recording again and again. Ends when standard input does.
"""

import sys
import threading

from playwright.sync_api import sync_playwright

from benchmarks.view.chromium import launch

SIZE = {"width": 1280, "height": 720}
CHECK_MS = 1000.0
"""Interval between checks whether the recording has ended."""


def main() -> int:
    ended = threading.Event()

    def wait_for_end() -> None:
        sys.stdin.read()
        ended.set()

    threading.Thread(target=wait_for_end, daemon=True).start()
    with sync_playwright() as playwright:
        page = launch(playwright).new_page(viewport=SIZE)
        page.goto(sys.argv[1])
        page.wait_for_selector("body:not([data-lost]) #state-label")
        print('{"event": "ready"}', flush=True)
        while not ended.is_set():
            if page.locator(".paused").count():
                page.keyboard.press("Space")
            page.wait_for_timeout(CHECK_MS)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
