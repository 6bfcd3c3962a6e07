"""The check of the site's pages in Chromium finds what a reader would see."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser

from tools.check_site import browser_problems

pytestmark = pytest.mark.slow

HEAD = "<!doctype html><meta name='viewport' content='width=device-width, initial-scale=1'>"


@pytest.mark.parametrize(
    ("body", "problem"),
    [
        ("<p>Text.</p>", ""),
        ("<div style='overflow-x: auto'><div style='width: 3000px'>wide</div></div>", ""),
        ("<div style='width: 600px'>wide</div>", "wider than the window: 608 of 390 px"),
        ("<img src='missing.png'>", "no picture"),
        ("<script>undefinedName()</script>", "undefinedName is not defined"),
        ("<script>console.error('broken')</script>", "broken"),
        ("<script src='http://127.0.0.1:9/a.js'></script>", "other host: http://127.0.0.1:9/a.js"),
    ],
)
def test_problems_of_a_page_are_found(
    browser: Browser, tmp_path: Path, body: str, problem: str
) -> None:
    (tmp_path / "page.html").write_text(f"{HEAD}<body>{body}</body>")
    found = browser_problems(browser, tmp_path)
    assert any(problem in text for text in found) if problem else found == []
