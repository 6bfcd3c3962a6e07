"""Publish the samples of an OpenIGTLink server on ROS topics."""

from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from app.bridge import topics
from app.bridge.node import RosNode
from app.bridge.tracker_publisher import TrackerPublisher
from app.geometry import TrackedTransform
from app.igtl.source import IgtlSource


class IgtlPublisher:
    """Publishes samples as `TrackerPublisher` does, and the connection on ``/diagnostics``."""

    def __init__(self, ros: RosNode) -> None:
        self._ros = ros
        self._tracker = TrackerPublisher(ros)
        self._diagnostics = ros.publisher(topics.DIAGNOSTICS)

    def publish(self, samples: Sequence[TrackedTransform]) -> None:
        """Publish ``samples``; the valid ones go into one ``/tf`` message."""
        self._tracker.publish(samples)

    def report(self, source: IgtlSource, superseded: int) -> None:
        """Publish the state of the connection and its counters on ``/diagnostics``."""
        now = self._ros.node.get_clock().now().to_msg()
        array = DiagnosticArray(status=[_diagnostic(source, superseded)])
        array.header.stamp = now
        self._diagnostics.publish(array)


def _diagnostic(source: IgtlSource, superseded: int) -> DiagnosticStatus:
    counts = source.counts()
    refused = any(": refused" in key for key in counts)
    level = DiagnosticStatus.WARN if refused else DiagnosticStatus.OK
    values = {
        **{key: str(count) for key, count in sorted(counts.items())},
        "samples that a newer one replaced": str(superseded),
        "last refusal": source.last_refusal,
    }
    return DiagnosticStatus(
        level=level if source.connected else DiagnosticStatus.ERROR,
        name="marginguard: OpenIGTLink",
        message=source.status,
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )
