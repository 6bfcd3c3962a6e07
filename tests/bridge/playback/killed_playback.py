"""A playback after SIGKILL: ``make test-playback``.

The lease of the killed process takes 20 s to expire, so it is not part of ``make test``, which does
not collect this file's name.
"""

import signal
import threading

from app.bridge.live.playback_watch import PlaybackWatch
from app.bridge.node import RosNode


def test_killed_playback_can_be_started_again_and_its_announcement_ends(playing, domain_id):
    playing().end(signal.SIGKILL)
    second = playing()  # the endpoints of the first one are still on the graph
    pause = threading.Event()
    with RosNode("session", domain_id=domain_id) as ros:
        watch = PlaybackWatch(ros, [])
        while "simulated lumpectomy 1" not in watch.found():
            pause.wait(0.05)
        second.end(signal.SIGKILL)
        assert watch.found().startswith("poses from a recording")
        while watch.found():  # the lease of the process has to expire: 20 s
            pause.wait(0.05)
