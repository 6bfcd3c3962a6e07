"""Record the imaging depths that an operator chooses, so that a replay places each image by its."""

import threading

from rclpy.serialization import serialize_message
from sensor_msgs.msg import Range

from app.bridge.bag_topics import bag_topic
from app.bridge.live.recorder import RosRecorder
from app.bridge.messages import header_message
from app.bridge.qos import NEWEST, Topic
from app.case import IMAGE_DEPTH_TOPIC, ImageDepths, LiveCase, SessionValues, image_depths
from app.geometry import ImageSample, InputError, Stamp

_TOPIC = Topic(IMAGE_DEPTH_TOPIC, Range, NEWEST)


class DepthRecorder:
    """Writes each chosen depth to `IMAGE_DEPTH_TOPIC`, and checks images by the depth in use."""

    def __init__(self, recorder: RosRecorder, depths: ImageDepths) -> None:
        self._recorder, self._depths = recorder, depths
        self._lock = threading.Lock()
        if depths.depths_mm:
            recorder.add_own(bag_topic(_TOPIC.name, _TOPIC))

    @classmethod
    def of(
        cls, recorder: RosRecorder, live: LiveCase, values: SessionValues | None
    ) -> "DepthRecorder | None":
        """For the images of ``live``, at the depth of ``values``; None without images."""
        entry = live.case.manifest.images
        if entry is None:
            return None
        depths = image_depths(live.case, entry)
        if values is not None and values.image_depth_mm is not None:
            depths.choose(values.image_depth_mm, None)
        return cls(recorder, depths)

    def write(self, depth_mm: float, from_ns: int) -> str:
        """Write that ``depth_mm`` holds for images stamped after ``from_ns``; return a note."""
        try:
            with self._lock:
                self._depths.choose(depth_mm, from_ns)
        except InputError as error:
            return str(error)
        message = Range(
            header=header_message("image", Stamp(from_ns)),
            radiation_type=Range.ULTRASOUND,
            range=depth_mm / 1000.0,
            max_range=max(self._depths.depths_mm) / 1000.0,
        )
        self._recorder.write_own(_TOPIC.name, bytes(serialize_message(message)))
        return f"depth of the images: {depth_mm:g} mm"

    def check(self, image: ImageSample) -> None:
        """Raise `InputError` for an image of another depth than the one in use at its stamp."""
        if image.stamp is not None:
            with self._lock:
                self._depths.check(image.stamp.ns, image.pixel_mm)
