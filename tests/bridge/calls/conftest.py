"""A peer process with plain rclpy."""

from pathlib import Path

import pytest

PEER = Path(__file__).resolve().parent / "peer.py"


@pytest.fixture
def peer(ros, start_receiver):
    return start_receiver(script=PEER)
