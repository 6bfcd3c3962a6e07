"""Follows a simulated world and sends edits of its bodies: the ROS side of `SimulatedWorld`."""

from app.bridge import topics
from app.bridge.body_surfaces import BodySurfaces
from app.bridge.node import RosNode
from app.bridge.qos import INCOMING_TF, Topic
from app.bridge.tf.wire import TfMessageReader
from app.bridge.world_editor import TRUTH, WORLD, WorldEditor
from app.geometry import MarginGuardError
from app.runtime import SimulatedWorld

_MAX_PLACES = 256


class WorldListener:
    """Gives ``world`` what the node ``simulation`` publishes, and takes its requests.

    All of it happens in the thread of ``ros``. Messages that are invalid are left out.
    """

    def __init__(self, ros: RosNode, simulation: str, world: SimulatedWorld) -> None:
        name = simulation.strip("/")
        self._ros, self._world = ros, world
        self._read = TfMessageReader()
        BodySurfaces(ros, name, world.set_bodies)
        ros.subscribe(Topic(topics.TF.name, topics.TF.type, INCOMING_TF), self._take_tf, raw=True)
        world.connect(WorldEditor(ros, name, world.refused))

    def _take_tf(self, data: bytes) -> None:
        if TRUTH.encode() not in data:
            return
        try:
            samples = self._read(data)
        except MarginGuardError as error:
            self._ros.warn(f"a pose of the simulated world was left out: {error}")
            return
        places = {
            each.child.removeprefix(TRUTH): each.pose
            for each in samples[:_MAX_PLACES]
            if each.parent == WORLD and each.child.startswith(TRUTH)
        }
        if places:
            self._world.set_places(places, samples[0].stamp_ns)
