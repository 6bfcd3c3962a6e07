"""Run ``pip install`` with the project's constraints; print one line at its start, one on failure.

The output of pip is written to ``.venv/install.log``.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CONSTRAINTS = "constraints.txt"  # relative to ROOT: pip splits PIP_CONSTRAINT at spaces
LOG = Path(sys.prefix) / "install.log"

NO_WHEEL = "no wheel of {what} for Python {python}: use Python 3.11 to 3.13 on Linux x86_64"
EXPLANATIONS = (
    # Pattern in the output of pip -> explanation. The first pattern that matches is used.
    (
        r"(?P<what>Temporary failure in name resolution|NewConnectionError|ReadTimeoutError)",
        "the package index could not be reached ({what}): check the network and try again",
    ),
    (r"No matching distribution found for (?P<what>\S+)", NO_WHEEL),
    (
        r"The user requested \(constraint\) (?P<what>\S+)",
        NO_WHEEL,
    ),  # pinned, not available
    (r"(?P<what>\S+) (was )?not found: install (?P<rest>.*)", "{what} not found: install {rest}"),
    (r"fatal error: (?P<what>Python\.h)", "{what} is missing: apt install python3-dev"),
    (r"fatal error: (?P<what>.+)", "the ROS interfaces do not compile: {what}"),
    (r"No space left on device", "the disk is full; expected 2 GB, with the tests 4 GB"),
    (r"ERROR: (?P<what>.+)", "{what}"),
)


def explain(output: str) -> str:
    """Explain the output of a failed pip in one sentence."""
    for pattern, sentence in EXPLANATIONS:
        found = re.search(pattern, output)
        if found is not None:
            python = f"{sys.version_info.major}.{sys.version_info.minor}"
            return sentence.format(**found.groupdict(), python=python)
    return "pip failed"


def main(arguments: list[str]) -> int:
    """Install ``arguments`` (as for ``pip install``) into this Python's environment."""
    print(f"Installing {' '.join(a for a in arguments if a != '-e')} ...", flush=True)
    # As variables the constraints also apply to the environments in which pip builds packages.
    constrained = {"PIP_CONSTRAINT": CONSTRAINTS, "PIP_BUILD_CONSTRAINT": CONSTRAINTS}
    done = subprocess.run(
        [sys.executable, "-m", "pip", "install", "--disable-pip-version-check", *arguments],
        cwd=ROOT,
        env={**os.environ, **constrained},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    LOG.write_text(done.stdout)
    if done.returncode != 0:
        print(f"marginguard: {explain(done.stdout)} (all of it: {LOG})", file=sys.stderr)
    return done.returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
