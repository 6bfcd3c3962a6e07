"""A peer process that returns messages and serves requests, and an rclpy node in this process."""

import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.ros_domain import domain_id as domain_id

PEER = Path(__file__).resolve().parent / "peer.py"


@pytest.fixture
def peer(domain_id: int) -> Iterator[subprocess.Popen[str]]:
    """`peer.py`, running in the test's ROS domain; ended by closing its standard input."""
    process = subprocess.Popen(
        [sys.executable, str(PEER)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    if process.stdout.readline().strip() != "ready":
        pytest.fail(f"the peer ended with status {process.wait()}")
    yield process
    process.communicate(timeout=30)
    assert process.returncode == 0


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
