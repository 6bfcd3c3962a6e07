"""Fixture: Debian's Chromium, driven by Playwright."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, expect, sync_playwright

from benchmarks.view.chromium import CHROMIUM, launch

# Time limit of an expectation; the 5 s of Playwright are too short on a busy machine.
expect.set_options(timeout=60_000)


# Playwright occupies the thread's event loop while it is open. With module scope at most one
# instance is open, and a module that runs its own event loop starts after it was closed.
@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    if not CHROMIUM.exists():
        pytest.skip(f"{CHROMIUM} is missing: apt-get install chromium")
    with sync_playwright() as playwright:
        browser = launch(playwright)
        yield browser
        browser.close()
