"""The ROS node of a replay: its publisher and the services of its player."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from app.bridge.environment import domain_of
from app.bridge.messages import playback_text
from app.bridge.node import RosNode
from app.bridge.player_services import PlayerServices
from app.bridge.publishing.session_publisher import SessionPublisher
from app.files.paths import state_folder
from app.hold import InstanceKey, host_id, refuse_beside_guard

if TYPE_CHECKING:
    from app.runtime import ReplayRun  # slow to load: with the compiled kernels

HEARTBEAT_HZ = 100.0
"""Rate at which the constraint is repeated while a replay follows real time."""


@contextmanager
def replay_node(run: "ReplayRun", *, real_time: bool) -> Iterator[RosNode]:
    """Publish the steps of ``run`` over ROS and let other nodes control its player.

    ``real_time``: the replay follows a clock, so the constraint is repeated between its steps. The
    recorded poses are announced on `app.bridge.topics.PLAYBACK` before the first one.

    Raises `SecondInstanceError` beside a guard, whose topics a replay would publish, too.
    """
    refuse_beside_guard(state_folder(), InstanceKey(host_id(), domain_of(), "/", ""))
    heartbeat_hz = HEARTBEAT_HZ if real_time else None
    with SessionPublisher(
        run.commands.content,
        heartbeat_hz=heartbeat_hz,
        playback=playback_text(run.prepared.case.manifest),
    ) as publisher:
        PlayerServices(publisher.ros, run.player)
        run.outputs.append(publisher)
        try:
            yield publisher.ros
        finally:
            run.outputs.remove(publisher)
