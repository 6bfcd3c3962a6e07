"""A second guard of one namespace or one arm, on this machine or elsewhere."""

import re
import signal

import pytest

from tests.bridge.conftest import CONSTRAINT, TF, TRACKED
from tests.bridge.live.guard_monitor import monitored
from tests.bridge.live.restarts import live, no_arm, other_arm, refusal

pytestmark = pytest.mark.long


@pytest.fixture
def config(live_yaml):
    return live_yaml(TRACKED)


def test_second_guard_of_a_namespace_or_an_arm_is_refused(
    start_live, start, start_receiver, config, project_root
):
    guard = start_live(config)
    receiver = start_receiver(CONSTRAINT)
    names_it = re.compile(
        rf"process {guard.process.pid} \(namespace '/', arm 'touch /joint_states'"
    )
    commands = [
        live(config),
        live(other_arm(config)),
        live(config, "--namespace", "watch"),
        ("-m", "app.cli", "view", "--live", "--config", str(config)),
        ("-m", "app.cli", "replay", str(project_root / "data/recorded_case"), "--rate", "1"),
    ]
    lines = [refusal(start(*command)) for command in commands]
    assert all(names_it.search(line) for line in lines)
    assert ["arm" in line.partition(" in ROS")[0] for line in lines] == [
        False,
        False,
        True,
        False,
        False,
    ]
    start(*live(other_arm(config), "--namespace", "watch")).line(
        lambda line: line.startswith("UNKNOWN")
    )
    ids = {message["message"]["instance_id"] for message in receiver.take(30)}
    assert len(ids) == 1  # no refused guard has published a constraint
    # The lock of a killed guard is free at once.
    guard.end(signal.SIGKILL)
    start(*live(config))
    receiver.until(lambda message: message["instance_id"] not in ids)


def test_guard_elsewhere_that_sends_is_found_on_the_graph(
    start_live, start, config, monkeypatch, tmp_path
):
    guard = start_live(config)
    # Another machine or user has another state folder.
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "elsewhere"))
    line = refusal(start(*live(config)))
    assert "/marginguard/constraint: node /marginguard publishes the constraint already" in line
    assert guard.process.poll() is None


@pytest.mark.parametrize("source", [TRACKED, TF], ids=["tracked", "tf"])
def test_guards_of_two_namespaces_that_publish_planes_are_no_second_senders(
    start_sender, start, live_yaml, domain_id, source
):
    config = live_yaml(source)
    guards = [start(*live(config)), start(*live(no_arm(config), "--namespace", "watch"))]
    for guard in guards:
        guard.line(lambda line: line.startswith("UNKNOWN"))
    kind = "tf" if "tf" in source else "tracked"
    with monitored(domain_id) as monitor:
        start_sender(kind, "again")
        guards[1].line(lambda line: not line.startswith("UNKNOWN"))
        monitor.make_permissive()
        for guard in guards:
            monitor.until(
                lambda each, log=guard.log: (
                    each.has_second_sender or "virtual_fixture on /tf" in log.read_text()
                )
            )
        assert not any(each.has_second_sender for each in monitor.received)
        monitor.make_permissive()
    assert all("virtual_fixture on /tf has several" in guard.log.read_text() for guard in guards)
