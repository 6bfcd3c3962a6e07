"""A live session is recorded by its service ``~/record``, in a process of its own."""

import json

import pytest
from marginguard_msgs.srv import SetTumor
from std_srvs.srv import SetBool

from app.bridge.calls import ServiceClient
from app.bridge.node import RosNode
from app.case import open_case
from tests.bridge.live.test_record_command import TRACKED, samples_of
from tests.bridge.service_calls import tumor
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.long


def test_session_is_recorded_between_two_requests(
    start_sender, start, live_yaml, breach, domain_id, tmp_path
):
    config, cases, audit = live_yaml(TRACKED), tmp_path / "cases", tmp_path / "audit.jsonl"
    arguments = ["--config", str(config), "--cases", str(cases), "--audit", str(audit)]
    live = start("-m", "app.cli", "live", *arguments)
    live.line(lambda line: line.startswith("UNKNOWN"))
    with RosNode("operator", domain_id=domain_id) as ros:
        record = ServiceClient(ros, SetBool, "/marginguard/record")

        def request(data: bool) -> SetBool.Response:
            return record.call(SetBool.Request(data=data), timeout_s=DEADLINE_S)

        refused = request(False)
        assert not refused.success
        assert refused.message.startswith("recording: none is running; expected one")
        begun = request(True)
        assert begun.success, begun.message
        (case,) = cases.iterdir()
        assert begun.message.startswith(f"recording to {case}: ")
        refused = request(True)
        assert not refused.success and "one is running" in refused.message
        # The recorder subscribes to the topic once it has a publisher, and then needs all of it.
        sender = start_sender("tracked", "again")
        shift_ns = int(sender.line(lambda line: line.startswith("shift")).split()[1])
        live.line(lambda line: "mm" in line)
        wait_until(lambda: samples_of(open_case(case).recorded_frames()))
        ended = request(False)
        assert ended.success, ended.message
        assert ended.message.startswith(f"recorded in {case}: ")
        assert sender.process.poll() is None
    assert (case / "tracking" / "metadata.yaml").exists()
    # The sender repeats its frames: each recorded pose is one of them, in a later round.
    sent = samples_of(breach)
    sources = {source for _, source in sent}
    found = [key for key in samples_of(open_case(case).recorded_frames()) if key[1] in sources]
    assert {source for _, source in found} == sources
    assert min(ns for ns, _ in found) >= shift_ns + min(ns for ns, _ in sent)
    live.stop()
    events = [json.loads(line) for line in audit.read_text().splitlines()]
    requests = [each for each in events if each["event"] == "request"]
    assert [(each["kind"], each["accepted"]) for each in requests] == [
        ("record", False),
        ("record", True),
        ("record", False),
        ("record", True),
    ]


def test_end_of_the_session_finishes_its_recording_which_contains_an_earlier_tumour(
    start, live_yaml, domain_id, tmp_path
):
    cases = tmp_path / "cases"
    live = start(
        "-m", "app.cli", "live", "--config", str(live_yaml(TRACKED)), "--cases", str(cases)
    )
    live.line(lambda line: line.startswith("UNKNOWN"))
    with RosNode("operator", domain_id=domain_id) as ros:
        client = ServiceClient(ros, SetTumor, "/marginguard/set_tumor")
        replaced = client.call(tumor(0.02), DEADLINE_S)
        assert replaced.success, replaced.message
        record = ServiceClient(ros, SetBool, "/marginguard/record")
        assert record.call(SetBool.Request(data=True), timeout_s=DEADLINE_S).success
    live.stop()
    (case,) = cases.iterdir()
    assert (case / "tracking" / "metadata.yaml").exists()
    assert not (case / "tracking" / "changes.yaml").exists()
    corners = {tuple(corner) for corner in open_case(case).tumor_mesh().vertices_mm.tolist()}
    assert corners == {(0, 0, 0), (20, 0, 0), (0, 20, 0), (0, 0, 20)}
