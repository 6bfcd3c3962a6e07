"""Run ``uv pip install`` with the project's constraints; one line at its start, one on failure.

uv installs in half of pip's time. pip installs it first; the index and the certificates are
those of pip's configuration, which uv does not read. All output is in ``.venv/install.log``.
"""

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CONSTRAINTS = "constraints.txt"  # relative to ROOT: the variables are split at spaces
LOG = Path(sys.prefix) / "install.log"
WHEELS = Path(sys.prefix) / "wheels"
"""Folder of the wheels that were built, by the name of their project's folder."""

UV_SETTINGS = {
    "index-url": "UV_DEFAULT_INDEX",
    "extra-index-url": "UV_INDEX",
    "find-links": "UV_FIND_LINKS",
    "cert": "SSL_CERT_FILE",
}
"""Setting of pip -> variable of uv."""

NO_WHEEL = "no wheel of {what} for Python {python}: use Python 3.11 to 3.13 on Linux x86_64"
EXPLANATIONS = (
    # Pattern in the output -> explanation. The first pattern that matches is used.
    (
        r"(?P<what>NewConnectionError|ReadTimeoutError|error sending request|operation timed out)",
        "the package index could not be reached ({what}): check the network and try again",
    ),
    (r"No matching distribution found for (?P<what>\S+)", NO_WHEEL),
    (r"there is no version of (?P<what>\S+)", NO_WHEEL),
    (r"was not found[\s\S]*\syou\s+require\s+(?P<what>[^\s,]+)", NO_WHEEL),
    (r"Because (?P<what>\S+) (was not found|has no wheels)", NO_WHEEL),
    (r"(?P<what>\S+) (was )?not found: install (?P<rest>.*)", "{what} not found: install {rest}"),
    (r"fatal error: (?P<what>Python\.h)", "{what} is missing: apt install python3-dev"),
    (r"fatal error: (?P<what>.+)", "the ROS interfaces do not compile: {what}"),
    (r"No space left on device", "the disk is full; expected 2 GB, with the tests 4 GB"),
    (r"cause: (?P<what>.+)", "{what}"),
    (r"(?i:error): (?P<what>.+)", "{what}"),
)


def explain(output: str) -> str:
    """Explain the output of a failed installation in one sentence."""
    for pattern, sentence in EXPLANATIONS:
        found = re.search(pattern, output)
        if found is not None:
            python = f"{sys.version_info.major}.{sys.version_info.minor}"
            return sentence.format(**found.groupdict(), python=python)
    return "the installation failed"


def settings(configuration: str) -> dict[str, str]:
    """Variables of uv for the lines of ``pip config list``; the last of several is used."""
    found = {}
    for line in configuration.splitlines():
        key, _, value = line.partition("=")
        variable = UV_SETTINGS.get(key.rpartition(".")[2])
        if variable is not None:
            found[variable] = " ".join(ast.literal_eval(value).split())
    return found


def run(*words: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run a module of this Python in the project's root."""
    return subprocess.run(
        [sys.executable, "-m", *words],
        cwd=ROOT,
        env={**os.environ, **variables},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )


def uv_variables() -> dict[str, str]:
    """Variables of uv, run in the project's root: the constraints and the settings of pip."""
    return {
        "UV_CONSTRAINT": CONSTRAINTS,
        "UV_BUILD_CONSTRAINT": CONSTRAINTS,
        "UV_INDEX_STRATEGY": "unsafe-best-match",  # any index, as pip
        **settings(run("pip", "config", "list").stdout),
    }


def wheel(name: str) -> Path:
    """The wheel of the project in the folder ``name``, which `main` has built."""
    (path,) = (WHEELS / name).glob("*.whl")
    return path


def main(arguments: list[str]) -> int:
    """Install ``arguments`` (as for ``pip install``) into this Python's environment.

    Of a folder without ``-e`` a source distribution is built, and from it the wheel in `WHEELS`.
    """
    print(f"Installing {' '.join(a for a in arguments if a != '-e')} ...", flush=True)
    done = run("pip", "--disable-pip-version-check", "install", "--constraint", CONSTRAINTS, "uv")
    output, variables, words = done.stdout, uv_variables(), arguments
    for folder in [each for each in arguments if each.startswith("./")]:
        if done.returncode != 0:
            break
        name = Path(folder).name
        shutil.rmtree(WHEELS / name, ignore_errors=True)
        into = ("--python", sys.executable, "--out-dir", str(WHEELS / name))
        done = run("uv", "build", *into, folder, **variables)
        output += done.stdout
        if done.returncode == 0:
            built = wheel(name)
            words = [str(built) if each == folder else each for each in words]
            words += ["--reinstall-package", built.name.split("-")[0]]
    if done.returncode == 0:
        done = run(
            *("uv", "pip", "install", "--python", sys.executable, "--compile-bytecode"),
            *words,
            **variables,
        )
        output += done.stdout
    LOG.write_text(output)
    if done.returncode != 0:
        print(f"marginguard: {explain(done.stdout)} (all of it: {LOG})", file=sys.stderr)
    return done.returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
