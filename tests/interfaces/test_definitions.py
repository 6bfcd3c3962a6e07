"""Compiled interface types compared with rosbags, which parses and hashes definitions itself."""

import json
import math
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from app.geometry import TrackingStatus

pytestmark = pytest.mark.slow


INTERFACES = Path(__file__).resolve().parents[2] / "interfaces"
MESSAGES = sorted(INTERFACES.glob("*_msgs/msg/*.msg"))


def type_name(path: Path) -> str:
    return f"{path.parts[-3]}/msg/{path.stem}"


@pytest.fixture(scope="module")
def jazzy() -> Typestore:
    """Types of Jazzy in rosbags: with tf2_msgs, without marginguard_msgs."""
    return get_typestore(Stores.ROS2_JAZZY)


@pytest.fixture(scope="module")
def with_marginguard() -> Typestore:
    """Types of Jazzy and of our definition files, read by the parser of rosbags."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for path in MESSAGES:
        if path.parts[-3] != "tf2_msgs":
            store.register(get_types_from_msg(path.read_text(), type_name(path)))
    return store


def compiled(name: str) -> Any:
    package, kind, message = name.split("/")
    return getattr(import_module(f"{package}.{kind}"), message)


def installed_hashes(name: str) -> Iterator[str]:
    """Yield the type hashes in the JSON files beside the installed definitions."""
    module = sys.modules[compiled(name).__module__]
    for prefix in Path(str(module.__file__)).parents:
        path = prefix / "share" / f"{name}.json"
        if path.is_file():
            for entry in json.loads(path.read_text())["type_hashes"]:
                if entry["type_name"] == name:
                    yield entry["hash_string"]


@pytest.mark.parametrize("name", ["tf2_msgs/msg/TFMessage", "tf2_msgs/msg/TF2Error"])
def test_tf2_msgs_are_those_of_jazzy(jazzy, name):
    constants, fields = jazzy.fielddefs[name]
    message = compiled(name)
    assert list(message.get_fields_and_field_types()) == [field for field, _ in fields]
    assert {const: getattr(message, const) for const, _, _ in constants} == {
        const: value for const, _, value in constants
    }
    assert list(installed_hashes(name)) == [jazzy.hash_rihs01(name)]


def test_follow_joint_trajectory_is_that_of_control_msgs():
    (found,) = installed_hashes("control_msgs/action/FollowJointTrajectory")
    assert found == "RIHS01_738ebcb7a2d7cfa42f9f1001cc99ce3a4383d1cfe508015d9be8485e4b1c66f6"


@pytest.mark.parametrize("path", MESSAGES, ids=type_name)
def test_type_hash_equals_that_of_rosbags(with_marginguard, path):
    assert list(installed_hashes(type_name(path))) == [
        with_marginguard.hash_rihs01(type_name(path))
    ]


def test_bytes_of_ros_are_read_by_rosbags(with_marginguard):
    from marginguard_msgs.msg import FixtureConstraint, HalfSpace
    from rclpy.serialization import serialize_message

    sent = FixtureConstraint(
        seq=3, reasons=["stale"], half_spaces=[HalfSpace(offset=0.25)], sigma_tre=0.5, hold=True
    )
    read = with_marginguard.deserialize_cdr(
        serialize_message(sent), "marginguard_msgs/msg/FixtureConstraint"
    )
    assert (read.seq, read.reasons, read.hold, read.sigma_tre) == (3, ["stale"], True, 0.5)
    assert read.half_spaces[0].offset == 0.25


def test_tracking_status_has_the_constants_of_the_message():
    from marginguard_msgs.msg import TrackedTransform

    assert {status.name: getattr(TrackedTransform, status.name) for status in TrackingStatus} == {
        status.name: status.value for status in TrackingStatus
    }


def test_discovered_publisher_has_the_same_hash(jazzy, ros):
    from tf2_msgs.msg import TFMessage

    ros.node.create_publisher(TFMessage, "edges", 1)
    (info,) = ros.node.get_publishers_info_by_topic("/edges")
    found = info.topic_type_hash
    assert f"RIHS{found.version:02}_{bytes(found.value).hex()}" == jazzy.hash_rihs01(
        "tf2_msgs/msg/TFMessage"
    )


def test_serialised_lost_pose_keeps_its_nan():
    from marginguard_msgs.msg import TrackedTransform
    from rclpy.serialization import deserialize_message, serialize_message

    lost = TrackedTransform(child_frame_id="cautery", status=TrackedTransform.OUT_OF_VIEW)
    lost.transform.rotation.w = float("nan")
    back = deserialize_message(serialize_message(lost), TrackedTransform)
    assert back.status == TrackedTransform.OUT_OF_VIEW
    assert math.isnan(back.transform.rotation.w)
