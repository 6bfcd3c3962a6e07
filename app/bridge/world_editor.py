"""Sends a user's edits of bodies to the simulation, which owns their frames."""

from collections.abc import Callable, Iterable

from geometry_msgs.msg import Point
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker

from app.bridge.messages import (
    header_message,
    metres,
    point_message,
    quaternion_message,
)
from app.bridge.node import RosNode
from app.bridge.qos import STREAM, Topic
from app.bridge.tf.wire import TfSample, write_tf_message
from app.geometry import Stamp, SurfaceMesh, Transform, quaternion_of_rotation

SIMULATION = "marginguard_simulation"
"""Name of the node of ``marginguard simulate``."""
WORLD = "world"
TRACKER = "tracker"
"""Frame of the simulated tracker, which has the pose of `WORLD`."""
BODIES = "bodies"
"""Topic of the simulation with the surfaces of its bodies."""
TRUTH = "truth/"
"""Prefix of the frames of true poses."""


class WorldEditor:
    """Requests to the simulation node ``simulation``; the stamp is the time of the user's edit.

    ``on_refused(reason)`` is called in the thread of ``ros``, also for requests of others.
    """

    def __init__(
        self, ros: RosNode, simulation: str, on_refused: Callable[[str], None] | None = None
    ) -> None:
        name = f"/{simulation.strip('/')}"
        self._ros = ros
        self._moves = ros.publisher(Topic(f"{name}/move_bodies", TFMessage, STREAM))
        self._changes = ros.publisher(Topic(f"{name}/edit_body", Marker, STREAM))
        self._refusals = None
        if on_refused is not None:
            self._refusals = ros.subscribe(
                Topic(f"{name}/refused_edits", String, STREAM), lambda each: on_refused(each.data)
            )

    def close(self) -> None:
        """Leave the graph; from any thread."""
        self._ros.call(self._destroy)

    def _destroy(self) -> None:
        self._ros.destroy_publisher(self._moves)
        self._ros.destroy_publisher(self._changes)
        if self._refusals is not None:
            self._ros.destroy_subscription(self._refusals)

    def is_connected(self) -> bool:
        """True if a simulation receives the requests."""
        return min(self._moves.get_subscription_count(), self._changes.get_subscription_count()) > 0

    def move(self, poses: Iterable[Transform], stamp: Stamp) -> None:
        """Request ``world_from_body`` of some bodies, all at once."""
        self._moves.publish(write_tf_message(tf_sample(each, stamp) for each in poses))

    def add(self, mesh: SurfaceMesh, world_from_body: Transform, stamp: Stamp) -> None:
        """Request a fixed body with the surface ``mesh``, which is in the body's frame."""
        marker = self._marker(world_from_body.source, Marker.ADD, world_from_body.target, stamp)
        marker.type = Marker.TRIANGLE_LIST
        marker.pose.position = point_message(world_from_body.translation_mm)
        marker.pose.orientation = quaternion_message(world_from_body)
        corners = metres(mesh.vertices_mm)[mesh.faces].reshape(-1, 3).tolist()
        marker.points = [Point(x=x, y=y, z=z) for x, y, z in corners]
        self._changes.publish(marker)

    def remove(self, name: str, stamp: Stamp) -> None:
        """Request the end of a body."""
        self._changes.publish(self._marker(name, Marker.DELETE, WORLD, stamp))

    @staticmethod
    def _marker(name: str, action: int, frame: str, stamp: Stamp) -> Marker:
        marker = Marker(header=header_message(frame, stamp), ns=name, action=action)
        marker.scale.x = marker.scale.y = marker.scale.z = 1.0
        marker.color.a = 1.0
        return marker


def tf_sample(pose: Transform, stamp: Stamp) -> TfSample:
    """``pose`` at ``stamp``, to be written by `write_tf_message`."""
    x, y, z = pose.translation_mm.tolist()
    place = (x, y, z, *quaternion_of_rotation(pose.rotation))
    return TfSample(pose.target, pose.source, stamp.ns, place)
