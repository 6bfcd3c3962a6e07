"""Check a built site: links and anchors, then every page in Chromium at three sizes (`make docs`).

    python -m tools.check_site out/docs

Links to other hosts are checked for their form and counted; they are not fetched.
"""

import sys
import tomllib
from pathlib import Path
from urllib.parse import SplitResult, unquote, urlsplit

from lxml import html
from playwright.sync_api import Browser, sync_playwright

from benchmarks.view.chromium import CHROMIUM, launch

ROOT = Path(__file__).resolve().parents[1]
REFERENCES = ("href", "src", "data")
SIZES = ((1440, 900), (1024, 768), (390, 844))
"""Windows of a desktop, a tablet and a phone, in CSS pixels."""
OVERFLOW = """() => {
    const { scrollWidth, clientWidth } = document.documentElement;
    return scrollWidth > clientWidth ? `${scrollWidth} of ${clientWidth} px` : '';
}"""
MISSING = """() => [...document.images]
    .filter(image => !image.complete || image.naturalWidth === 0).map(image => image.src)"""


def repository_files() -> str:
    """Beginning of the links to files of the project: its repository URL in pyproject.toml."""
    urls = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["urls"]
    return f"{urls['Repository']}/blob/main/"


def link_problems(site: Path, repository: str, root: Path) -> tuple[list[str], list[str]]:
    """Broken links of all pages below ``site``, and the sorted links to other hosts.

    ``repository`` is the beginning of links to files of the project, which is in ``root``.
    """
    pages = {path.resolve(): html.parse(path) for path in sorted(site.rglob("*.html"))}
    anchors = {path: set(tree.xpath("//@id | //a/@name")) for path, tree in pages.items()}
    problems, external = [], set()
    for path, tree in pages.items():
        for target in sorted({str(t) for name in REFERENCES for t in tree.xpath(f"//@{name}")}):
            url = urlsplit(target)
            if url.scheme in ("http", "https"):
                external.add(target)
                problem = _external_problem(target, url, repository, root)
            elif url.scheme in ("mailto", "data"):
                continue
            else:
                file = (path.parent / unquote(url.path)).resolve() if url.path else path
                problem = _internal_problem(file, unquote(url.fragment), anchors)
            if problem:
                problems.append(f"{path.relative_to(site.resolve())}: {target}: {problem}")
    return problems, sorted(external)


def _external_problem(target: str, url: SplitResult, repository: str, root: Path) -> str:
    if target.startswith(repository):
        path = target.removeprefix(repository).partition("#")[0]
        return "" if (root / path).exists() else "no such file in the project"
    host = url.hostname or ""
    if "." not in host.strip(".") or any(c.isspace() for c in target):
        return "malformed URL; expected https://host.domain/path"
    return ""


def _internal_problem(file: Path, fragment: str, anchors: dict[Path, set[str]]) -> str:
    if not file.is_file():
        return "no such file"
    if fragment and file in anchors and fragment not in anchors[file]:
        return "no such anchor"
    return ""


def browser_problems(browser: Browser, site: Path) -> list[str]:
    """Horizontal overflow, console errors, missing pictures and requests to other hosts."""
    page = browser.new_page()
    events: list[str] = []
    page.on("console", lambda m: events.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda error: events.append(str(error)))
    page.on("requestfailed", lambda request: events.append(f"not loaded: {request.url}"))
    page.on(
        "request",
        lambda r: events.append(f"other host: {r.url}") if r.url.startswith("http") else None,
    )
    problems = []
    for path in sorted(site.rglob("*.html")):
        if path == site / "index.html":  # leads to docs/index.html
            continue
        page.goto(path.as_uri(), wait_until="load")
        found = [f"no picture: {source}" for source in page.evaluate(MISSING)] + events
        events.clear()
        for width, height in SIZES:
            page.set_viewport_size({"width": width, "height": height})
            if wide := page.evaluate(OVERFLOW):
                found.append(f"wider than the window: {wide}")
        problems += [f"{path.relative_to(site)}: {problem}" for problem in found]
    page.close()
    return problems


def main(arguments: list[str]) -> int:
    """Check the site in the folder ``arguments[0]``; return 1 if there are problems."""
    site = Path(arguments[0]).resolve()
    problems, external = link_problems(site, repository_files(), ROOT)
    if not CHROMIUM.exists():
        problems.append(f"{CHROMIUM} is missing: apt-get install chromium")
    else:
        with sync_playwright() as playwright:
            browser = launch(playwright)
            problems += browser_problems(browser, site)
            browser.close()
    for problem in problems:
        print(f"check_site: {problem}", file=sys.stderr)
    outside = [url for url in external if not url.startswith(repository_files())]
    for url in outside:
        print(f"form checked, not fetched: {url}")
    count = sum(1 for _ in site.rglob("*.html"))
    print(
        f"{count} pages, {len(problems)} problems; {len(outside)} links to other hosts not fetched"
    )
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
