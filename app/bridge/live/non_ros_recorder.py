"""Record what does not come over ROS: an OpenIGTLink server, and the imaging depths chosen."""

import threading
from collections.abc import Callable, Sequence

from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image, Range
from std_msgs.msg import Bool

from app.bridge.live.ros_recorder import RosRecorder
from app.bridge.live.sources import said_by
from app.bridge.messages import header_message
from app.bridge.session_bag import bag_topic
from app.bridge.topics import NEWEST, Topic
from app.bridge.tracker_publisher import TRACKED_TRANSFORMS, message_of_image, tracked_message
from app.case import (
    ENERGY_DEVICE,
    IMAGE_DEPTH_TOPIC,
    ImageDepths,
    LiveCase,
    SessionValues,
    image_depths,
)
from app.case.live_file import IgtlSourceEntry
from app.case.new_case import IGTL_ACTIVATION_TOPIC, IGTL_IMAGES_TOPIC
from app.geometry import ImageSample, InputError, MarginGuardError, Stamp, TrackedTransform
from app.igtl import DeviceImages, Header, IgtlSource

_DEPTH = Topic(IMAGE_DEPTH_TOPIC, Range, NEWEST)
_IMAGES = Topic(IGTL_IMAGES_TOPIC, Image, NEWEST)
_ACTIVATION = Topic(IGTL_ACTIVATION_TOPIC, Bool, NEWEST)


class DepthRecorder:
    """Writes each chosen depth to `IMAGE_DEPTH_TOPIC`, and checks images by the depth in use."""

    def __init__(self, recorder: RosRecorder, depths: ImageDepths) -> None:
        self._recorder, self._depths = recorder, depths
        self._lock = threading.Lock()
        if depths.depths_mm:
            recorder.add_own(bag_topic(_DEPTH.name, _DEPTH))

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
        self._recorder.write_own(_DEPTH.name, bytes(serialize_message(message)))
        return f"depth of the images: {depth_mm:g} mm"

    def check(self, image: ImageSample) -> None:
        """Raise `InputError` for an image of another depth than the one in use at its stamp."""
        if image.stamp is not None:
            with self._lock:
                self._depths.check(image.stamp.ns, image.pixel_mm)


class IgtlRecorder:
    """Writes the poses, and the images of ``live``, that its server sends to ``recorder``.

    It is a client of the server of its own. Every pose is on ``/tracked_transforms``, with the
    server's stamp and status, every image of the session's device on `IGTL_IMAGES_TOPIC`, and the
    activation on `IGTL_ACTIVATION_TOPIC`. Images of another depth than that of ``depths``
    are refused, as in the session. ``report`` takes changes of the connection, and why an image is
    refused, until the reason changes.
    """

    def __init__(
        self,
        recorder: RosRecorder,
        live: LiveCase,
        source: IgtlSourceEntry,
        depths: DepthRecorder | None,
        report: Callable[[str], None],
    ) -> None:
        self._recorder, self._report, self._depths = recorder, report, depths
        self._problem = ""
        recorder.add_own(bag_topic(TRACKED_TRANSFORMS.name, TRACKED_TRANSFORMS))
        entry = live.case.manifest.images
        images = None
        if entry is not None and entry.topic is None:
            recorder.add_own(bag_topic(_IMAGES.name, _IMAGES))
            self._images = DeviceImages(live.image_device)
            images = self._write_image
        activation = live.case.manifest.activation
        self._activation_device = None if activation is None else activation.device
        strings = None
        if self._activation_device is not None:
            recorder.add_own(bag_topic(_ACTIVATION.name, _ACTIVATION))
            strings = self._write_activation
        self._source = IgtlSource(
            source.host,
            source.port,
            self._write_poses,
            changed=report,
            images=images,
            strings=strings,
        )

    @property
    def problem(self) -> str:
        """The reason why the server sends nothing; empty if connected. Raises a failure of it."""
        self._source.counts()
        return self._source.problem

    def close(self) -> None:
        """Write nothing more."""
        self._source.close()

    def _write_poses(self, samples: Sequence[TrackedTransform]) -> None:
        for sample in samples:
            data = bytes(serialize_message(tracked_message(sample)))
            self._recorder.write_own(TRACKED_TRANSFORMS.name, data)

    def _write_activation(self, header: Header, body: bytes) -> None:
        said = said_by(self._activation_device or "", header, body)
        if isinstance(said, bool):
            self._recorder.write_own(_ACTIVATION.name, bytes(serialize_message(Bool(data=said))))
        elif said is not None and said != self._problem:
            self._problem = said
            self._report(f"state of the {ENERGY_DEVICE.name} not recorded: {said}")

    def _write_image(self, header: Header, body: bytes) -> None:
        try:
            image = self._images.read(header, body)
            if image is None:  # of another device
                return
            if self._depths is not None:
                self._depths.check(image)
            message = message_of_image(image)
        except MarginGuardError as error:
            if str(error) != self._problem:
                self._problem = str(error)
                self._report(f"image not recorded: {error}")
            return
        self._problem = ""
        self._recorder.write_own(_IMAGES.name, bytes(serialize_message(message)))
