"""Debian's Chromium, the one browser of all tests."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, sync_playwright

from benchmarks.view.chromium import CHROMIUM, launch


# Playwright holds the thread's event loop as long as it is open: no second one may be open beside
# it, and a module that runs a loop of its own has to come after it.
@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    if not CHROMIUM.exists():
        pytest.skip(f"{CHROMIUM} is not there: apt-get install chromium")
    with sync_playwright() as playwright:
        browser = launch(playwright)
        yield browser
        browser.close()
