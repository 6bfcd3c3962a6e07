"""Opens a report in Chromium and keeps what it logs and requests."""

from playwright.sync_api import Page


def opened(page: Page, address: str) -> tuple[list[str], list[str]]:
    """Open ``address``; return the lists of problems and of requests, to which the page adds."""
    problems: list[str] = []
    requests: list[str] = []
    page.on("console", lambda message: problems.append(message.text))
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))
    page.goto(address)
    return problems, requests
