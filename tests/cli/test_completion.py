"""Completion scripts: bash completes with the printed script."""

import shutil
import subprocess

import pytest

from tests.cli.command import run

pytestmark = pytest.mark.slow

COMPLETE = """
source "$1"; shift
name=$(complete -p marginguard | sed 's/.*-F \\([^ ]*\\).*/\\1/')
while read -ra words; do
  COMP_WORDS=("${words[@]}"); COMP_CWORD=$((${#words[@]} - 1)); COMPREPLY=()
  "$name" marginguard "${words[-1]}" "${words[-2]}"
  echo "${COMPREPLY[@]}"
done
"""


@pytest.fixture
def script(tmp_path):
    """``script(shell)`` writes the completion script of a shell to a file."""

    def write(shell):
        path = tmp_path / f"completion.{shell}"
        path.write_text(run("doctor", "completion", shell).out)
        return path

    return write


def test_bash_completes(script, tmp_path):
    (tmp_path / "cases").mkdir()
    (tmp_path / "live.yaml").touch()
    (tmp_path / "movies").mkdir()
    (tmp_path / "movie.gif").touch()
    expected = {
        "repl": {"replay"},
        "replay --rep": {"--report"},
        "calibrate piv": {"pivot"},
        "bench lat": {"latency"},
        "convert mo": {"movies", "movie.gif"},
        "convert recover x mo": {"movies", "movie.gif"},
        "tracker igtl --por": {"--port"},
        "doctor cl": {"clean"},
        "info ca": {"cases"},
        "live --config live": {"live.yaml"},
        "replay x --package-dir mo": {"movies"},
        "replay x --movie mo": {"movies", "movie.gif"},
        "doctor schema case --output mo": {"movies", "movie.gif"},
    }
    done = subprocess.run(
        ["bash", "-c", COMPLETE, "bash", str(script("bash"))],
        input="".join(f"marginguard {words}\n" for words in expected),
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
    )
    found = (set(line.split()) for line in done.stdout.splitlines())
    assert dict(zip(expected, found, strict=True)) == expected


@pytest.mark.parametrize("shell", ["zsh", "tcsh"])
def test_script_of_other_shell(script, shell):
    path = script(shell)
    assert "make-case" in path.read_text()
    if shutil.which(shell):
        subprocess.run([shell, "-n", str(path)], check=True)
