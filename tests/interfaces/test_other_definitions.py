"""Two installations with different message definitions on one graph, really built and connected."""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.bridge.live.test_live_command import TRACKED
from tests.python_process import run_python
from tests.waiting import wait_until

PEER = Path(__file__).with_name("other_peer.py")
pytestmark = [
    pytest.mark.long,
    pytest.mark.timeout(1200),
]  # Compiling the package takes minutes on a busy machine

DIAGNOSTICS = "/diagnostics:diagnostic_msgs/msg/DiagnosticArray:1000000"
REMEDY = "install the same marginguard_msgs on both sides"


@pytest.fixture(scope="module")
def other_site(tmp_path_factory: pytest.TempPathFactory, project_root: Path) -> Path:
    """Folder with a ``marginguard_msgs`` whose messages have one more field."""
    folder = tmp_path_factory.mktemp("other")
    source = folder / "interfaces"
    shutil.copytree(
        project_root / "interfaces", source, ignore=shutil.ignore_patterns("build", "*.egg-info")
    )
    for name, line in (("FixtureConstraint", "uint64 seq"), ("TrackedTransform", "string child")):
        path = source / "marginguard_msgs" / "msg" / f"{name}.msg"
        text = path.read_text()
        assert f"\n{line}" in text
        path.write_text(text.replace(f"\n{line}", f"\nfloat64 extra\n{line}", 1))
    project = source / "pyproject.toml"
    lines = project.read_text().splitlines()
    for package in ("tf2_msgs", "control_msgs"):  # less to compile
        shutil.rmtree(source / package)
        lines = [line for line in lines if f'"{package}.' not in line]
    project.write_text("\n".join(lines) + "\n")
    site = folder / "site"
    install = [sys.executable, "-m", "pip", "install", "--no-deps", "--target", str(site)]
    done = subprocess.run(
        [*install, str(source)],
        env={
            **os.environ,
            "PIP_BUILD_CONSTRAINT": str(project_root / "constraints.txt"),
            "CFLAGS": "-O0",  # less time to compile
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return site


def next_status(receiver, name, accept):
    """The status ``name`` of the first report of diagnostics that ``accept`` accepts."""
    while True:
        parts = {part["name"]: part for part in receiver.take(1)[0]["message"]["status"]}
        if accept(parts):
            return parts.get(name)


def test_messages_of_another_version_are_not_used_and_named(
    start_sender, start_live, other_site, start, start_receiver, live_yaml, tmp_path
):
    config = str(live_yaml(TRACKED))
    live = start_live(config)
    start_sender("tracked", "again")
    live.line(lambda line: line.startswith("POSITIVE"))

    receiver = start_receiver(DIAGNOSTICS)
    tracked = ("/tracked_transforms", "TrackedTransform")
    other = start(PEER, str(other_site), "publish", *tracked)
    other.line(lambda line: line.startswith("matched"))
    live.line(lambda line: line.startswith("UNKNOWN") and "stale" in line)
    # The name of a node may be known later than its publisher.
    messages = next_status(
        receiver,
        "marginguard: messages",
        lambda parts: (
            "marginguard: messages" in parts
            and "/tracked_transforms: /other_version (RIHS01_"
            in parts["marginguard: messages"]["message"]
        ),
    )
    assert "its messages are not used" in messages["message"]
    assert REMEDY in messages["message"]

    # A subscriber of another version cannot read our constraint, and is named too.
    constraint = ("/marginguard/constraint", "FixtureConstraint")
    reader = start(PEER, str(other_site), "subscribe", *constraint)
    reader.line(lambda line: line.startswith("matched"))
    next_status(
        receiver,
        "",
        lambda parts: "misreads our messages" in parts["marginguard: messages"]["message"],
    )

    recorder = start("-m", "app.cli", "record", "-o", str(tmp_path / "recorded"))
    # The recorder names the other version when it starts the topic, or later if it did not know it.
    named = "/tracked_transforms.*: /other_version.* has another definition"
    wait_until(lambda: re.search(named, recorder.log.read_text()))
    recorder.stop()

    # Without the other publisher the samples are used again.
    other.end(signal.SIGKILL)
    live.line(lambda line: "latched" in line and not line.startswith("UNKNOWN"))
    live.stop()
    log = live.log.read_text()
    assert log.count("its messages are not used") == 1
    assert log.count("misreads our messages") == 1
    assert "Traceback" not in log


def test_guard_of_another_version_is_not_rearmed(other_site, start):
    constraint = ("/marginguard/constraint", "FixtureConstraint")
    start(PEER, str(other_site), "publish", *constraint)
    operator = start("-m", "app.cli", "rearm", "--yes")
    assert operator.wait() == 2
    log = operator.log.read_text()
    assert "/other_version (RIHS01_" in log
    assert REMEDY in log


def test_controller_of_the_examples_uses_no_constraint_beside_such_a_guard(
    other_site, start_live, start_sender, start, live_yaml, project_root
):
    start_live(str(live_yaml(TRACKED)))
    other = start(PEER, str(other_site), "publish", "/marginguard/constraint", "FixtureConstraint")
    filtered = start(project_root / "examples" / "controller" / "twist_filter.py")
    named = "guards with other message definitions: "
    wait_until(lambda: f"{named}/other_version" in filtered.log.read_text())
    other.end(signal.SIGKILL)
    wait_until(lambda: f"{named}none" in filtered.log.read_text())
    start_sender("tracked", "again")
    start(project_root / "examples" / "controller" / "push.py")
    wait_until(lambda: re.search(r"guard [0-9a-f]{16}\n", filtered.log.read_text()))


def test_program_with_messages_of_another_version_does_not_start(
    other_site, domain_id, project_root
):
    command = ("-m", "app.cli", "rearm", "--yes")
    done = run_python(
        *command,
        status=2,
        env={**os.environ, "PYTHONPATH": f"{other_site}{os.pathsep}{project_root}"},
    )
    error = done.stderr.splitlines()[-1]
    assert "marginguard_msgs/msg/FixtureConstraint: the installed definition" in error
    assert "run 'pip install ./interfaces'" in error
