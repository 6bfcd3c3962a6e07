"""Before the first constraint of a live session: no other guard, and the hold of the last run."""

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

from rclpy.logging import get_logger

from app.bridge.environment import domain_of
from app.bridge.live.other_guard import SilentPublishers, find_silent_publishers
from app.bridge.node import RosNode
from app.files.state_folder import state_folder
from app.fixture import Reason
from app.hold import InstanceKey, LiveState, arm_name, host_id, live_state
from app.runtime import (
    PreparedLive,
    used_values,
)
from app.session.session import NOTHING_OUTSIDE


@dataclass(frozen=True, slots=True)
class GuardStart:
    """The kept ``state`` of a session, and the ``silent`` publishers that were there before it."""

    state: LiveState
    silent: SilentPublishers

    def faults(self, ros: RosNode) -> Mapping[Reason, str]:
        """Faults of the session outside its samples: another guard may have its place.

        Raises `BridgeError` for one that has not gone after the lease of the middleware.
        """
        if self.state.problem:
            return {Reason.SECOND_SENDER: self.state.problem}
        return self.silent.faults(ros) or NOTHING_OUTSIDE


@contextmanager
def guard_start(
    prepared: PreparedLive, name: str, namespace: str, ros: RosNode | None
) -> Iterator[GuardStart]:
    """Make sure that this is the only guard; keep its hold and values on disk within the context.

    ``name`` is that of the node. Raises `SecondInstanceError` or `BridgeError` beside another
    guard, and `StateFileError` if a hold could not be kept for the next run.
    """
    logger = get_logger(name)
    domain_id = domain_of() if ros is None else ros.node.context.get_domain_id()
    key = _key(prepared, domain_id, namespace if ros is None else ros.node.get_namespace())
    used = used_values(prepared.content)
    with live_state(state_folder(), key, used, clock_ns=time.time_ns, log=logger.error) as state:
        silent = find_silent_publishers(name, key.namespace, domain_id)
        for cause in state.start_causes:
            logger.warning(f"HOLD: {cause}")
        yield GuardStart(state, silent)


def _key(prepared: PreparedLive, domain_id: int, namespace: str) -> InstanceKey:
    robot, entry = prepared.setup.robot, prepared.case.manifest.robot
    arm = ""
    if robot is not None:
        arm = arm_name(robot.robot.name, None if entry is None else entry.joint_states)
    return InstanceKey(host_id(), domain_id, f"/{namespace.strip('/')}", arm)
