"""Process of `benchmarks.soak` that shows the page of a live session in headless Chromium.

    browser.py URL

Ends when standard input does.
"""

import sys

from playwright.sync_api import sync_playwright

from benchmarks.view.chromium import launch

SIZE = {"width": 1280, "height": 720}


def main() -> int:
    with sync_playwright() as playwright:
        page = launch(playwright).new_page(viewport=SIZE)
        page.goto(sys.argv[1])
        page.wait_for_selector("body:not([data-lost]) #state-label")
        print('{"event": "ready"}', flush=True)
        sys.stdin.read()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
