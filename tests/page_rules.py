"""The rules of axe-core for WCAG 2.2 A and AA, applied to a page in a browser."""

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page

RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]


def violations(page: Page) -> list[str]:
    """Each violated rule with the elements that violate it."""
    options = {"runOnly": RULES, "resultTypes": ["violations"]}  # of the others one element each
    found = Axe().run(page, options=options).response
    assert len(found["passes"]) > 10
    return [
        f"{each['id']}: {', '.join(node['html'][:120] for node in each['nodes'])}"
        for each in found["violations"]
    ]
