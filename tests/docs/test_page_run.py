"""The runner of pages: a block that fails, prints something else or is skipped is an error."""

import os
from pathlib import Path

import pytest

from tests.docs.page_blocks import blocks_of
from tests.docs.page_run import PageRun


def run(folder: Path, page: str) -> PageRun:
    """Execute a page with the text ``page``."""
    (folder / "page.md").write_text(page)
    (folder / "project").mkdir()
    (folder / "run").mkdir()
    page_run = PageRun(folder / "project", folder / "run", {})
    page_run.run(folder / "page.md")
    return page_run


PASSING = {
    "variables and the folder are kept": "```sh\nmkdir a && cd a && x=1 && export y=2\n```\n"
    "```sh\necho $(basename $PWD) $y\n```\n```text\na 2\n```\n",
    "lines between two shown ones": "```sh\nseq 5\n```\n```text\n2\n...\n5\n```\n",
    "any text in a line": "```sh\necho 3.1 of 7 mm\n```\n```text\n3... mm\n```\n",
    "a file": "<!-- file: a/b.yaml -->\n```yaml\nx: 1\n```\n"
    "```sh\ncat a/b.yaml\n```\n```text\nx: 1\n```\n",
    "an expected failure": "<!-- status: 3 -->\n```sh\nexit 3\n```\n",
    "a command that succeeds later": "<!-- terminal 2; until: a -->\n"
    "```sh\necho a; sleep 0.2; touch b; sleep 60\n```\n<!-- retry -->\n```sh\nls b\n```\n",
    "a second terminal": "<!-- terminal 2; until: ready -->\n```sh\necho ready; sleep 60\n```\n"
    "```sh\necho first\n```\n<!-- terminal 2 -->\n```sh\necho second\n```\n",
    "output that arrives later": "<!-- terminal 2; until: a -->\n```sh\necho a; sleep 0.2; echo b\n"
    "```\n<!-- terminal 2 -->\n```text\nb\n```\n",
    "output after Ctrl-C": "<!-- terminal 2; until: a -->\n"
    "```sh\ntrap 'touch b' INT\necho a\nsleep 60 || true\n```\n"
    "<!-- terminal 3; until: c -->\n```sh\necho c; until ls b; do sleep 0.1; done; echo gone\n```\n"
    "<!-- terminal 3; ctrl-c 2 -->\n```text\ngone\n```\n",
    "one Python session": "```sh\n. .venv/bin/activate\n```\n```python\nx = 2\n```\n"
    "```python\nprint(x + 1)\n```\n```text\n3\n```\n",
    "a block in a list": "- item\n\n  ```sh\n  echo a\n  ```\n\n  ```text\n  a\n  ```\n",
}
FAILING = {
    "a command fails": "```sh\nfalse\necho after\n```\n",
    "another status": "<!-- status: 3 -->\n```sh\nexit 2\n```\n",
    "other output": "```sh\necho 1\n```\n```text\n2\n```\n",
    "lines in another order": "```sh\nseq 3\n```\n```text\n2\n1\n```\n",
    "ends without the awaited text": "<!-- terminal 2; until: a -->\n```sh\necho b\n```\n",
    "Python raises": "```sh\n. .venv/bin/activate\n```\n```python\n1 / 0\n```\n",
    "no reason": "<!-- not run -->\n```sh\nfalse\n```\n",
    "a block that is no program and no file": "```yaml\nx: 1\n```\n",
    "another installation": "<!-- install -->\n```sh\npip install marginguard\n```\n",
    "fails on Ctrl-C": "<!-- terminal 2; until: a -->\n"
    "```sh\ntrap 'exit 5' INT\necho a\nwhile sleep 0.1; do :; done\n```\n",
}


@pytest.mark.parametrize("page", PASSING.values(), ids=PASSING.keys())
def test_a_page_that_works_passes(tmp_path, page):
    assert run(tmp_path, page).not_run == []


@pytest.mark.parametrize("page", FAILING.values(), ids=FAILING.keys())
def test_a_page_that_does_not_work_fails_with_the_line(tmp_path, page):
    with pytest.raises(AssertionError, match=r"page\.md:\d+|after Ctrl-C"):
        run(tmp_path, page)


def test_no_python_session_is_left_after_an_error(tmp_path):
    page = (
        "```sh\n. .venv/bin/activate\n```\n"
        "```python\nimport os\nprint(os.getpid(), file=open('pid', 'w'))\n1 / 0\n```\n"
    )
    with pytest.raises(AssertionError, match="ZeroDivisionError"):
        run(tmp_path, page)
    pid = int((tmp_path / "run" / "marginguard" / "pid").read_text())
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_blocks_that_are_not_run_are_listed_with_their_reason(tmp_path):
    page = "<!-- not run: needs a tracker -->\n```sh\nfalse\n```\n"
    assert run(tmp_path, page).not_run == ["needs a tracker"]


@pytest.mark.parametrize(
    "page", ["<!-- termnal 2 -->\n```sh\ntrue\n```\n", "```sh\ntrue\n```\n\n```sh\nunclosed\n"]
)
def test_misspelt_keys_and_open_fences_are_errors(tmp_path, page):
    (tmp_path / "page.md").write_text(page)
    with pytest.raises(ValueError, match=r"page\.md"):
        blocks_of(tmp_path / "page.md")
