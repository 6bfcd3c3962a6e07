"""Debian's Chromium without a window, as the benchmark and the tests of the page have it."""

from pathlib import Path

from playwright.sync_api import Browser, Playwright

CHROMIUM = Path("/usr/bin/chromium")
_ARGUMENTS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


def launch(playwright: Playwright) -> Browser:
    """A browser that asks nobody but the page's server."""
    return playwright.chromium.launch(executable_path=CHROMIUM, args=_ARGUMENTS)
