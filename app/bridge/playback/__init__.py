"""Play a recording onto the ROS graph, as the drivers of a tracker and a robot would publish it.

Recorded poses must not be mistaken for those of a patient. A playback announces itself on
`app.bridge.topics.PLAYBACK`, and it does not share its topics with another publisher.
"""

from app.bridge.playback.playback_node import NODE_NAME, PlaybackNode
from app.bridge.playback.sole_source import SoleSource

__all__ = ["NODE_NAME", "PlaybackNode", "SoleSource"]
