"""Headless Chromium of Debian, for the benchmark and the tests of the page."""

from pathlib import Path

from playwright.sync_api import Browser, Playwright

CHROMIUM = Path("/usr/bin/chromium")
SIZE = {"width": 1280, "height": 720}  # size of the pages that are measured
ARGUMENTS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


def launch(playwright: Playwright) -> Browser:
    """Start a browser without background network traffic."""
    return playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
