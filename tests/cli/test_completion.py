"""Completion scripts: bash completes with the printed script."""

import shutil
import subprocess

import pytest

from app.cli.main import main

COMPLETE = """
source "$1"; shift
words=("$@")
COMP_WORDS=("${words[@]}"); COMP_CWORD=$((${#words[@]} - 1)); COMPREPLY=()
name=$(complete -p marginguard | sed 's/.*-F \\([^ ]*\\).*/\\1/')
"$name" marginguard "${words[-1]}" "${words[-2]}"
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.fixture
def script(tmp_path, capsys):
    """``script(shell)`` writes the completion script of a shell to a file."""

    def write(shell):
        assert main(["completion", shell]) == 0
        path = tmp_path / f"completion.{shell}"
        path.write_text(capsys.readouterr().out)
        return path

    return write


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["repl"], {"replay"}),
        (["replay", "--rep"], {"--report"}),
        (["calibrate", "piv"], {"pivot"}),
        (["bench", "lat"], {"latency"}),
        (["info", "ca"], {"cases"}),
        (["live", "--config", "live"], {"live.yaml"}),
        (["replay", "x", "--package-dir", "mo"], {"movies"}),
        (["replay", "x", "--movie", "mo"], {"movies", "movie.gif"}),
        (["schema", "case", "--output", "mo"], {"movies", "movie.gif"}),
    ],
)
def test_bash_completes(script, tmp_path, words, expected):
    path = script("bash")
    (tmp_path / "cases").mkdir()
    (tmp_path / "live.yaml").touch()
    (tmp_path / "movies").mkdir()
    (tmp_path / "movie.gif").touch()
    done = subprocess.run(
        ["bash", "-c", COMPLETE, "bash", str(path), "marginguard", *words],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
    )
    assert set(done.stdout.split()) == expected


@pytest.mark.parametrize("shell", ["zsh", "tcsh"])
def test_script_of_other_shell(script, shell):
    path = script(shell)
    assert "make-case" in path.read_text()
    if shutil.which(shell):
        subprocess.run([shell, "-n", str(path)], check=True)
