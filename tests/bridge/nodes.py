"""Several ROS nodes in one process."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from app.bridge.node import RosNode


@contextmanager
def ros_nodes(domain_id: int, *names: str) -> Iterator[list[RosNode]]:
    with ExitStack() as stack:
        yield [stack.enter_context(RosNode(name, domain_id=domain_id)) for name in names]
