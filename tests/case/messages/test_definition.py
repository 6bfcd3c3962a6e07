import sys
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from app.case import message_definition
from app.geometry import InputError

PREFIXES = [Path(sys.prefix)]


@pytest.mark.parametrize(
    "name",
    ["tf2_msgs/msg/TFMessage", "sensor_msgs/msg/JointState", "visualization_msgs/msg/MarkerArray"],
)
def test_definitions_are_those_that_rosbags_knows(name):
    types = get_types_from_msg(message_definition(name, PREFIXES), name)
    known = get_typestore(Stores.ROS2_JAZZY)
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    # The hash of a type covers its fields and all of their types.
    assert store.hash_rihs01(name) == known.hash_rihs01(name)


def test_definitions_of_this_project_include_nested_types():
    name = "marginguard_msgs/msg/FixtureConstraint"
    types = get_types_from_msg(message_definition(name, PREFIXES), name)
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    assert store.generate_msgdef(name, ros_version=2)
    assert "marginguard_msgs/msg/HalfSpace" in types


@pytest.mark.parametrize("name", ["no_such_msgs/msg/Nothing", "std_msgs/String", "../msg/Secret"])
def test_unknown_types_are_refused(name):
    with pytest.raises(InputError):
        message_definition(name, PREFIXES)
