"""The check of the site's pages in Chromium finds what a reader would see."""

import pytest
from playwright.sync_api import Browser

from tools.check_site import browser_problems

pytestmark = pytest.mark.slow

HEAD = "<!doctype html><meta name='viewport' content='width=device-width, initial-scale=1'>"

PAGES = [
    ("<p>Text.</p>", ""),
    ("<div style='overflow-x: auto'><div style='width: 3000px'>wide</div></div>", ""),
    ("<div style='width: 600px'>wide</div>", "wider than the window: 608 of 390 px"),
    ("<img src='missing.png'>", "no picture"),
    ("<script>undefinedName()</script>", "undefinedName is not defined"),
    ("<script>console.error('broken')</script>", "broken"),
    ("<script src='http://127.0.0.1:9/a.js'></script>", "other host: http://127.0.0.1:9/a.js"),
]
"""The body of each page, and its problem."""


@pytest.fixture(scope="module")
def problems(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Problems of a site of all pages."""
    site = tmp_path_factory.mktemp("site")
    for number, (body, _) in enumerate(PAGES):
        (site / f"{number}.html").write_text(f"{HEAD}<body>{body}</body>")
    return browser_problems(browser, site)


@pytest.mark.parametrize("number", range(len(PAGES)))
def test_problems_of_a_page_are_found(problems, number):
    _, problem = PAGES[number]
    found = [text for text in problems if text.startswith(f"{number}.html: ")]
    assert any(problem in text for text in found) if problem else found == []
