"""The check of the site's links finds broken ones, and accepts those that hold."""

from pathlib import Path

import pytest

from tools.check_site import link_problems

REPOSITORY = "https://github.com/owner/name/blob/main/"


def problems_of(folder: Path, link: str) -> list[str]:
    """Problems of a site of two pages, one of which has ``link``."""
    site = folder / "site"
    (site / "docs").mkdir(parents=True)
    (site / "first.html").write_text(f"<body>{link}</body>")
    (site / "docs" / "second.html").write_text('<body><h2 id="units">Units</h2></body>')
    (folder / "case.yaml").write_text("")
    return link_problems(site, REPOSITORY, folder)[0]


@pytest.mark.parametrize(
    "link",
    [
        '<a href="docs/second.html">page</a>',
        '<a href="docs/second.html#units">anchor</a>',
        '<p id="here"><a href="#here">anchor of the page itself</a></p>',
        f'<a href="{REPOSITORY}case.yaml">file of the project</a>',
        '<a href="https://example.org/page">another host</a>',
        '<img src="data:image/png;base64,AAAA">',
    ],
)
def test_valid_links_are_accepted(tmp_path, link):
    assert problems_of(tmp_path, link) == []


@pytest.mark.parametrize(
    ("link", "problem"),
    [
        ('<a href="docs/third.html">page</a>', "no such file"),
        ('<a href="docs/second.html#unit">anchor</a>', "no such anchor"),
        ('<a href="#there">anchor of the page itself</a>', "no such anchor"),
        ('<img src="missing.png">', "no such file"),
        (f'<a href="{REPOSITORY}no.yaml">file</a>', "no such file in the project"),
        ('<a href="https://example/page">host without a domain</a>', "malformed URL"),
        ('<a href="https://example.org/a page">space</a>', "malformed URL"),
    ],
)
def test_broken_links_are_found(tmp_path, link, problem):
    (found,) = problems_of(tmp_path, link)
    assert found.startswith("first.html: ")
    assert problem in found


def test_links_to_other_hosts_are_listed(tmp_path):
    (tmp_path / "page.html").write_text('<a href="https://example.org/page">another host</a>')
    assert link_problems(tmp_path, REPOSITORY, tmp_path) == ([], ["https://example.org/page"])
