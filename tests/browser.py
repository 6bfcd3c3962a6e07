"""Fixtures: Debian's Chromium, driven by Playwright; one for all tests of a process."""

import asyncio
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, expect, sync_playwright

from benchmarks.view.chromium import CHROMIUM, launch

# Time limit of an expectation; it only ends a hang, on a busy machine too.
expect.set_options(timeout=300_000)

Chromium = tuple[Browser, asyncio.AbstractEventLoop]


@pytest.fixture(scope="session")
def chromium() -> Iterator[Chromium]:
    """The browser, and Playwright's event loop, which has stopped between two modules."""
    if not CHROMIUM.exists():
        pytest.skip(f"{CHROMIUM} is missing: apt-get install chromium")
    playwright = sync_playwright().start()
    browser, loop = launch(playwright), asyncio.get_running_loop()
    asyncio._set_running_loop(None)
    yield browser, loop
    asyncio._set_running_loop(loop)
    browser.close()
    playwright.stop()


# Playwright marks its event loop as the running one of the thread from its first call on. The mark
# is taken away after each module, so that the tests of the next one can run their own event loop.
@pytest.fixture(scope="module")
def browser(chromium: Chromium) -> Iterator[Browser]:
    browser, loop = chromium
    asyncio._set_running_loop(loop)
    yield browser
    asyncio._set_running_loop(None)
