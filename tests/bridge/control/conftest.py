"""A node that serves the control topics."""

import pytest

from app.bridge.node import RosNode


@pytest.fixture
def ros(domain_id):
    with RosNode("marginguard", domain_id=domain_id) as node:
        yield node
