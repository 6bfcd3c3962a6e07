"""A peer process that returns messages and serves requests, and an rclpy node in this process."""

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.bridge.conftest import Child, Start
from tests.bridge.conftest import shared_fields as shared_fields
from tests.bridge.conftest import start as start
from tests.bridge.conftest import start_receiver as start_receiver
from tests.ros_domain import domain_id as domain_id

PEER = Path(__file__).resolve().parent / "peer.py"


@pytest.fixture
def peer(start: Start) -> Iterator[Child]:
    """`peer.py`, running in the test's ROS domain; ended by closing its standard input."""
    process = start(PEER)
    assert process.line() == "ready"
    yield process
    process.end_input()
    assert process.wait() == 0


@pytest.fixture
def node(domain_id: int) -> Iterator[object]:
    """An rclpy node that a thread spins."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain_id)
    node = rclpy.create_node("test_interfaces", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    spinning = threading.Thread(target=executor.spin)
    spinning.start()
    yield node
    executor.shutdown()
    rclpy.shutdown(context=context)
    spinning.join(timeout=30)
    node.destroy_node()
