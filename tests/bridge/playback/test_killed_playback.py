"""A playback after SIGKILL: the lease of the killed process takes 20 s to expire."""

import signal

import pytest

from app.bridge.live.inputs import PlaybackWatch
from app.bridge.node import RosNode
from tests.waiting import wait_until

pytestmark = pytest.mark.long


def test_killed_playback_can_be_started_again_and_its_announcement_ends(playing, domain_id):
    playing().end(signal.SIGKILL)
    second = playing()  # the endpoints of the first one are still on the graph
    with RosNode("session", domain_id=domain_id) as ros:
        watch = PlaybackWatch(ros, [])
        wait_until(lambda: "simulated lumpectomy 1" in watch.found())
        second.end(signal.SIGKILL)
        assert watch.found().startswith("poses from a recording")
        wait_until(lambda: not watch.found())  # the lease of the process has to expire: 20 s
