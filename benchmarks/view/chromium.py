"""Headless Chromium of Debian, for the benchmark and the tests of the page."""

from pathlib import Path

from playwright.sync_api import Browser, BrowserType, Playwright

CHROMIUM = Path("/usr/bin/chromium")
SIZE = {"width": 1280, "height": 720}
"""Size of the pages that are measured."""

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
    """Start a browser without background network traffic."""
    return playwright.chromium.launch(executable_path=CHROMIUM, args=_ARGUMENTS)


def launch_webgl(browser_type: BrowserType) -> Browser:
    """Start a browser that draws WebGL by software (SwiftShader)."""
    arguments = [each for each in _ARGUMENTS if each != "--disable-gpu"]
    software = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
    return browser_type.launch(executable_path=CHROMIUM, args=[*arguments, *software])
