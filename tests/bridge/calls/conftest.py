"""A `RosNode` in this process and a peer process with plain rclpy."""

from pathlib import Path

import pytest

from app.bridge.node import RosNode

PEER = Path(__file__).resolve().parent / "peer.py"


@pytest.fixture
def ros(domain_id):
    with RosNode("marginguard", domain_id=domain_id) as node:
        yield node


@pytest.fixture
def peer(ros, start_receiver):
    return start_receiver(script=PEER)
