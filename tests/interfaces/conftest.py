"""The fixtures of the ROS tests."""

from tests.bridge.conftest import breach as breach
from tests.bridge.conftest import frames_file as frames_file
from tests.bridge.conftest import live_yaml as live_yaml
from tests.bridge.conftest import ros as ros
from tests.bridge.conftest import start as start
from tests.bridge.conftest import start_live as start_live
from tests.bridge.conftest import start_receiver as start_receiver
from tests.bridge.conftest import start_sender as start_sender
from tests.ros_domain import domain_id as domain_id
