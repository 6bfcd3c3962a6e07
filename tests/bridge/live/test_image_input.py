"""Images of a live session from a ROS topic and from OpenIGTLink messages."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Image

from app.bridge import RosNode
from app.bridge.convert import image_message
from app.bridge.displays.session_client import TopicImages
from app.bridge.live.outputs import ChosenDepth
from app.bridge.topics import NEWEST, Topic
from app.bridge.tracker_publisher import IgtlImagePublisher
from app.case import DepthCalibration, ImageDepths, TrackingFrame
from app.geometry import (
    ImageCalibration,
    ImageSample,
    ImageStatus,
    Stamp,
    TrackedTransform,
    Transform,
)
from app.igtl.framing import HEADER_BYTES, read_header
from app.igtl.image_messages import image_message as igtl_message
from app.runtime import ImageDepth, ImageDescription, StepTiming
from app.session import LiveImages
from tests.case.images.sequences import some_pixels
from tests.session_content import one_link_content
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.slow

TOPIC = Topic("/us/image", Image, NEWEST)
PIXELS = some_pixels(8, 6, 5)
LIMIT_NS = 10**9


def some_images() -> LiveImages:
    depths = ImageDepths.one(ImageCalibration("probe", np.diag([0.1, 0.1, 0.1, 1.0])))
    return LiveImages(depths, stale_after_ns=LIMIT_NS, max_gap_ns=LIMIT_NS)


def shown(images: LiveImages, ns: int) -> np.ndarray | None:
    """The pixels that a page would show at ``ns``."""
    pose = Transform("reference", "probe", np.eye(3), np.zeros(3))
    images.add_poses([TrackedTransform.valid(pose, Stamp(at)) for at in (ns - 10**6, ns + 10**6)])
    found = images.at(ns, "reference")
    if found.number is None or found.pose.matrix is None:
        return None
    return images.image(found.number).pixels


def test_image_of_a_topic_is_shown_and_a_refused_one_covers_it(ros, other):
    images = some_images()
    publisher = other.publisher(TOPIC)
    topic = TopicImages(ros, TOPIC.name, "UF", images)
    stamps = iter(range(10**9, 10**12, 10**6))

    def send(pixels: np.ndarray = PIXELS[0], encoding: str = "mono8") -> int:
        ns = next(stamps)
        publisher.publish(image_message(pixels, encoding, "image", Stamp(ns)))
        return ns

    wait_until(lambda: images.size, send)
    last_ns = send(PIXELS[3])
    wait_until(lambda: np.array_equal(shown(images, last_ns), PIXELS[3][:, ::-1]))
    send(np.zeros((6, 5, 3), np.uint8), "bgr8")
    expected = "/us/image: encoding of the image is 'bgr8'; expected mono8, mono16, rgb8"
    wait_until(lambda: images.at(last_ns, "reference").pose.problem == expected)
    assert shown(images, last_ns) is None
    topic.close()


def test_images_of_two_publishers_are_refused(ros, other):
    images = some_images()
    publishers = [other.publisher(TOPIC), ros.publisher(TOPIC)]
    topic = TopicImages(ros, TOPIC.name, "MF", images)
    stamps = iter(range(10**9, 10**12, 10**6))

    def send() -> None:
        for each in publishers:
            each.publish(image_message(PIXELS[0], "mono8", "image", Stamp(next(stamps))))

    expected = "/us/image has 2 publishers of images; expected 1"
    wait_until(lambda: images.at(0, "reference").pose.problem == expected, send)
    topic.close()


def packet(device: str, number: int, pixel_mm: float = 1.0) -> tuple[object, bytes]:
    """An image whose matrix turns it by ``number`` rad and has pixels of that size."""
    sample = ImageSample(0, Stamp((number + 1) * 10**9), ImageStatus.OK, PIXELS[number])
    turn = Rotation.from_rotvec([0.3 * number, number, 0.0]).as_matrix()
    content = igtl_message(device, sample, affine(pixel_mm * turn))
    return read_header(content[:HEADER_BYTES]), content[HEADER_BYTES:]


class Taken:
    """Double of a display: the stamps and the pixels of the published images that it receives."""

    def __init__(self, ros: RosNode) -> None:
        self.images: dict[int, np.ndarray] = {}
        ros.subscribe(TOPIC, self._take)

    def _take(self, message: Image) -> None:
        stamp = message.header.stamp
        pixels = np.frombuffer(bytes(message.data), np.uint8)
        shape = message.height, message.width
        self.images[stamp.sec * 10**9 + stamp.nanosec] = pixels.reshape(shape)


def test_igtl_images_of_one_device_are_published(ros, other):
    taken, reported = Taken(other), []
    igtl = IgtlImagePublisher(ros, TOPIC.name, None, reported.append)
    ros.wait_for_subscribers(TOPIC, 1, DEADLINE_S)
    wait_until(lambda: taken.images, lambda: igtl.receive(*packet("Image_Probe", 0)))
    igtl.receive(*packet("Other", 5))
    header, body = packet("Image_Probe", 1)
    igtl.receive(header, body[:-1] + bytes([body[-1] ^ 1]))
    wait_until(lambda: igtl.problem)
    assert "checksum" in igtl.problem
    wait_until(lambda: 2 * 10**9 in taken.images, lambda: igtl.receive(header, body))
    assert igtl.problem == ""
    np.testing.assert_array_equal(taken.images[2 * 10**9], PIXELS[1])
    assert set(taken.images) == {10**9, 2 * 10**9}
    igtl.close()


def depths(*depths_mm: float) -> ImageDescription:
    """Images whose pixels measure 0.005 mm for each mm of depth; no depths: 0.2 mm."""
    matrices = {depth_mm: np.diag([*[depth_mm / 200.0] * 3, 1.0]) for depth_mm in depths_mm}
    matrices = matrices or {None: np.diag([0.2, 0.2, 0.2, 1.0])}
    calibrations = [
        DepthCalibration(depth_mm, ImageCalibration("probe", matrix))
        for depth_mm, matrix in matrices.items()
    ]
    return ImageDescription(
        TOPIC.name, "MF", tuple(calibrations), calibrations[0].depth_mm, LIMIT_NS, LIMIT_NS
    )


def test_igtl_image_of_another_depth_is_not_published(ros, other):
    """Size and type of the pixels stay the same: the calibration would place it wrongly."""
    taken, reported = Taken(other), []
    chosen = ChosenDepth(one_link_content(), depths())
    igtl = IgtlImagePublisher(ros, TOPIC.name, "Image", reported.append, chosen.check)
    wait_until(lambda: taken.images, lambda: igtl.receive(*packet("Image", 0, 0.2)))
    igtl.receive(*packet("Image", 1, 0.25))
    wait_until(lambda: igtl.problem)
    assert igtl.problem == (
        "image has pixels of 0.25 x 0.25 mm; expected 0.2 x 0.2 mm, as the first one of the "
        "session: the calibration holds for one depth"
    )
    wait_until(lambda: 3 * 10**9 in taken.images, lambda: igtl.receive(*packet("Image", 2, 0.2)))
    assert 2 * 10**9 not in taken.images
    assert reported == ["image has pixels of 0.25 x 0.25 mm; expected 0.2 x 0.2 mm, as the first "
                        "one of the session: the calibration holds for one depth"]  # fmt: skip
    igtl.close()


def test_igtl_image_of_another_listed_depth_names_the_depth_to_choose(ros, other):
    """It is refused until an operator chooses that depth."""
    taken = Taken(other)
    content = replace(one_link_content(), image_depth=ImageDepth((40.0, 50.0), 40.0))
    chosen = ChosenDepth(content, depths(40.0, 50.0))
    igtl = IgtlImagePublisher(ros, TOPIC.name, "Image", lambda text: None, chosen.check)
    wait_until(lambda: taken.images, lambda: igtl.receive(*packet("Image", 0, 0.2)))
    igtl.receive(*packet("Image", 1, 0.25))
    wait_until(lambda: igtl.problem)
    assert igtl.problem == (
        "image has pixels of 0.25 x 0.25 mm, those of depth 50 mm; expected those of depth 40 mm "
        "(0.2 x 0.2 mm), which is in use: choose depth 50 mm"
    )
    deeper = replace(content, image_depth=ImageDepth((40.0, 50.0), 50.0))
    chosen.publish(SimpleNamespace(frame=TrackingFrame(Stamp(2 * 10**9), ())), StepTiming())
    chosen.prepare(deeper)(deeper)
    assert chosen.choice == (50.0, 2 * 10**9)
    wait_until(lambda: 3 * 10**9 in taken.images, lambda: igtl.receive(*packet("Image", 2, 0.25)))
    igtl.close()


def affine(linear: np.ndarray) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = linear
    return matrix
