"""Images of a bag: each as it was written, placed by the poses around its stamp."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from app.case import BagTopic, BagWriter, Case, open_case, open_case_images
from app.case.case_images import IMAGE_DEPTH_TOPIC, BagImages
from app.case.messages.message_values import IMAGE
from app.case.messages.ros_messages import (
    RANGE,
    TRACKED_TRANSFORM,
    TRACKED_TRANSFORMS_TOPIC,
    ros_types,
)
from app.geometry import NS_PER_MS, InputError, Stamp, TrackedTransform, Transform
from tests.case.images.sequences import some_pixels
from tests.case.images.ultrasound_case import PROBE_FROM_IMAGE
from tests.case.messages.test_image_message import encoded, message
from tests.cli.small_case import write_small_case
from tests.oracles.ros_objects import tracked_transform_message
from tests.refusals import refused

TOPIC = "/us/image"
COUNT, ROWS, COLUMNS = 12, 30, 40
PIXELS = some_pixels(COUNT, ROWS, COLUMNS)
START_NS, STEP_NS = 100 * 10**9, 30 * NS_PER_MS


def stamp(number: int) -> int:
    """Images lie between the poses, which come every 20 ms."""
    return START_NS + 5 * NS_PER_MS + number * STEP_NS


def image(number: int, encoding: str = "mono8", **changes: object) -> bytes:
    content = message(PIXELS[number], encoding, **changes)
    content.header.stamp.sec, content.header.stamp.nanosec = divmod(stamp(number), 10**9)
    return encoded(content)


def pose(name: str, ns: int) -> bytes:
    x_mm = (ns - START_NS) / NS_PER_MS if name == "probe" else 0.0
    moved = Transform("tracker", name, np.eye(3), np.array([x_mm, 0.0, 0.0]))
    sample = TrackedTransform.valid(moved, Stamp(ns))
    return bytes(ros_types().serialize_cdr(tracked_transform_message(sample), TRACKED_TRANSFORM))


def chosen_depth(depth_mm: float, ns: int) -> bytes:
    """A ``sensor_msgs/Range`` by rosbags."""
    types = ros_types().types
    time = types["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9)
    header = types["std_msgs/msg/Header"](time, "image")
    content = types[RANGE](header, 0, 0.0, 0.0, 0.0, depth_mm / 1000.0, 0.0)
    return bytes(ros_types().serialize_cdr(content, RANGE))


def write_bag(folder: Path, images: list[bytes], depths: dict[int, float]) -> None:
    bag = BagWriter(folder)
    topics = {TRACKED_TRANSFORMS_TOPIC: TRACKED_TRANSFORM, TOPIC: IMAGE, IMAGE_DEPTH_TOPIC: RANGE}
    for topic, kind in topics.items():
        definition, _ = ros_types().generate_msgdef(kind, ros_version=2)
        bag.add_topic(BagTopic(topic, kind, definition))
    for tick in range(20):
        ns = START_NS + 20 * tick * NS_PER_MS
        for name in ("needle", "rod", "probe"):
            data = pose(name, ns)
            bag.write(TRACKED_TRANSFORMS_TOPIC, data, received_ns=ns, published_ns=ns)
    for number, data in enumerate(images):
        bag.write(TOPIC, data, received_ns=stamp(number), published_ns=stamp(number))
        if number % 3 == 0:
            bag.flush()  # ends a chunk
    for ns, depth_mm in depths.items():
        data = chosen_depth(depth_mm, ns)
        bag.write(IMAGE_DEPTH_TOPIC, data, received_ns=ns, published_ns=ns)
    bag.close()


def case_with(folder, images, chosen_depths=None, **changes):
    """A case with ``changes`` of ``images``; a key that is None is left out."""
    calibration = {"probe": "probe", "calibration": "image_to_probe.txt"}
    entry = {"topic": TOPIC, **calibration, **changes}
    entry = {key: value for key, value in entry.items() if value is not None}
    write_small_case(
        folder, lambda manifest: manifest.update(images=entry, recording={"path": "tracking"})
    )
    numbers = np.vstack([PROBE_FROM_IMAGE, (0, 0, 0, 1)]).ravel()
    (folder / "image_to_probe.txt").write_text(" ".join(f"{value:g}" for value in numbers))
    write_bag(folder / "tracking", images, chosen_depths or {})
    return open_case(folder)


def images_of(case: Case) -> BagImages:
    found = open_case_images(case)
    assert isinstance(found, BagImages)
    return found


def test_each_image_is_as_written_and_at_the_place_of_its_own_stamp(tmp_path):
    images = images_of(case_with(tmp_path / "case", [image(n) for n in range(COUNT)]))
    assert (len(images), images.size) == (COUNT, (COLUMNS, ROWS))
    for number in (11, 0, 7, 3, 4):
        found = images.at(stamp(number) + 2 * NS_PER_MS, "tracker")
        assert (found.number, found.pose.problem) == (number, "")
        expected = np.vstack([PROBE_FROM_IMAGE, (0, 0, 0, 1)])
        expected[0, 3] += 5 + 30 * number  # mm
        np.testing.assert_allclose(found.pose.matrix, expected, rtol=0, atol=1e-6)
        sample = images.image(number)
        assert sample.stamp == Stamp(stamp(number))
        np.testing.assert_array_equal(sample.pixels, PIXELS[number])
    late_ns = stamp(COUNT - 1) + 201 * NS_PER_MS
    assert images.at(late_ns, "tracker").pose.problem == (
        "image 11 is 201 ms old; expected at most 200 ms"
    )
    assert images.at(START_NS, "tracker").pose.problem == "no image yet"
    with pytest.raises(InputError, match="image 12 does not exist"):
        images.image(12)


def test_orientation_is_that_of_the_case(tmp_path):
    images = images_of(case_with(tmp_path / "case", [image(0)], orientation="UN"))
    np.testing.assert_array_equal(images.image(0).pixels, PIXELS[0][::-1, ::-1])


def test_refused_images_are_left_out(tmp_path):
    other_size = encoded(message(PIXELS[1][:20], "mono8"))
    data = [image(0), image(1, "bgr8"), other_size, b"\0\1", image(4)]
    images = images_of(case_with(tmp_path / "case", data))
    assert len(images) == 2
    np.testing.assert_array_equal(images.image(1).pixels, PIXELS[4])


@pytest.mark.parametrize(
    ("images", "changes", "expected"),
    [
        ([], {}, "has no image on /us/image; expected sensor_msgs/Image"),
        ([b"\0\1\0\0"], {}, "has no image on /us/image: image message of 4 bytes is cut"),
        ([image(0)], {"topic": "/other"}, "has no image on /other"),
        ([image(0)], {"probe": "rdo"}, "images.probe is 'rdo', which has no pose; expected one of"),
        ([image(0)], {"calibration": "none.xml"}, "images.calibration is 'none.xml': no such file"),
    ],
)
def test_images_that_cannot_be_used_are_found_when_the_case_is_opened(
    tmp_path, images, changes, expected
):
    with refused(text=expected):
        case_with(tmp_path / "case", images, **changes)


def test_file_that_changed_meanwhile_is_reported(tmp_path):
    images = images_of(case_with(tmp_path / "case", [image(n) for n in range(COUNT)]))
    (part,) = (tmp_path / "case" / "tracking").glob("*.mcap")
    part.write_bytes(part.read_bytes()[:1000])
    with pytest.raises(InputError, match="has changed"):
        images.image(9)


def test_case_that_was_changed_to_mcap_keeps_the_calibration(tmp_path):
    from app.case import convert_case

    case = case_with(tmp_path / "case", [image(n) for n in range(COUNT)])
    convert_case(case, tmp_path / "copy")
    assert yaml.safe_load((tmp_path / "copy/case.yaml").read_text())["images"]["topic"] == TOPIC
    copied = images_of(open_case(tmp_path / "copy"))
    np.testing.assert_array_equal(copied.image(5).pixels, PIXELS[5])
