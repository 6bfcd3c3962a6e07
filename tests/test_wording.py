"""Wording of docstrings and of commit subjects."""

import ast
import re
import shutil
import subprocess
from pathlib import Path

import pytest

RIDDLE = re.compile(r"(?:What|Which|How|Why|Of|As|That of)\b")
"""First words of a text that describes a thing by a question or by its neighbour."""
BEGINS_SO = re.compile(rf'"""\s*{RIDDLE.pattern}')
"""Such a text anywhere in a file; only files with one are parsed, which takes longer."""
MAX_SUBJECT_CHARS = 72
CHECKED_COMMITS = 50


@pytest.fixture(scope="module")
def git(project_root: Path):
    """A function that returns the lines that a git command prints."""
    if not (project_root / ".git").exists() or shutil.which("git") is None:
        pytest.skip("needs git and a checkout")

    def lines(*arguments: str) -> list[str]:
        command = ["git", "-C", str(project_root), *arguments]
        return subprocess.check_output(command, text=True).splitlines()

    return lines


def docstrings(text: str) -> list[tuple[int, str]]:
    """Line and text of each docstring, also of those below a constant or an attribute."""
    return [
        (node.lineno, node.value.value.strip())
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    ]


def test_docstrings_say_what_a_thing_is_or_does(project_root, git):
    found = [
        f"{name}:{line}: {text.splitlines()[0]}"
        for name in git("ls-files", "--cached", "--others", "--exclude-standard", "*.py")
        if (path := project_root / name).is_file()
        if BEGINS_SO.search(code := path.read_text("utf-8"))
        for line, text in docstrings(code)
        if RIDDLE.match(text)
    ]
    assert found == [], "expected a noun phrase or a verb"


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ('"""What a file holds."""\n', 1),
        ('class A:\n    """\n    As `B`.\n    """\n', 1),
        ('def f():\n    """That of the last step."""\n', 1),
        ('X = 1\n"""Of the last step."""\n', 1),
        ('"""Whatever, Office, Assembly."""\nX = """What is no docstring"""\n', 0),
        ('"""Data of a step: what it shows."""\n', 0),
    ],
)
def test_each_kind_of_docstring_is_checked(code, found):
    assert len([text for _, text in docstrings(code) if RIDDLE.match(text)]) == found


def test_subjects_of_commits_are_short(git):
    subjects = git("log", f"--max-count={CHECKED_COMMITS}", "--format=%s")
    assert [text for text in subjects if len(text) > MAX_SUBJECT_CHARS] == []
