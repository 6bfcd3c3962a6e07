"""Player services called by another process."""

import math

import pytest

from app.bridge.node import RosNode
from app.bridge.replay_node import PlayerServices
from app.case import Player
from app.case.frame_streams import TrackingFrame
from app.geometry import Stamp
from tests.bridge.service_calls import CALLER

pytestmark = pytest.mark.slow

TRIGGER = "std_srvs/srv/Trigger"
SEEK = "marginguard_msgs/srv/Seek"
SET_RATE = "marginguard_msgs/srv/SetRate"


@pytest.fixture
def player():
    frames = [TrackingFrame(Stamp(second * 10**9), ()) for second in range(10)]
    return Player(lambda: iter(frames), clock_ns=lambda: 0, rate=None)


@pytest.fixture
def call(domain_id, start_receiver, player):
    """``call("pause:TYPE:{}", ...)`` gives the replies to another process."""
    with RosNode("marginguard", domain_id=domain_id) as ros:
        PlayerServices(ros, player)

        def calls(*arguments):
            full = [f"/marginguard/{argument}" for argument in arguments]
            return start_receiver(*full, script=CALLER).messages()

        yield calls


def test_pause_step_seek_and_play_services(call, player):
    replies = call(f"pause:{TRIGGER}:{{}}", f"step:{TRIGGER}:{{}}", f'seek:{SEEK}:{{"time": 4.0}}')
    assert [reply["success"] for reply in replies] == [True, True, True]
    assert replies[2]["time"] == 4.0
    assert player.paused
    # A seek while paused plays only the frame at that time.
    frames = player.play()
    assert next(frames).stamp.ns == 4 * 10**9
    assert call(f"play:{TRIGGER}:{{}}")[0]["success"]
    assert not player.paused
    assert [frame.stamp.ns // 10**9 for frame in frames] == [5, 6, 7, 8, 9]


def test_refused_request_has_a_reason(call, player):
    seek, rate = call(f'seek:{SEEK}:{{"time": -1.0}}', f'set_rate:{SET_RATE}:{{"rate": 0.0}}')
    assert not seek["success"]
    assert "-1.0" in seek["message"]
    assert math.isnan(seek["time"])
    assert not rate["success"]
    assert "0.001 to 1000" in rate["message"]
    assert len(list(player.play())) == 10


def test_infinite_rate_does_not_wait(call, player):
    # The clock of this player does not advance: at a rate of 1 it would wait indefinitely.
    player.set_rate(1.0)
    (reply,) = call(f'set_rate:{SET_RATE}:{{"rate": Infinity}}')
    assert reply == {"success": True, "message": ""}
    assert len(list(player.play())) == 10
