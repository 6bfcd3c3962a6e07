"""The fixtures of the live session's tests."""

from tests.bridge.conftest import start_receiver as start_receiver
from tests.bridge.live.conftest import breach as breach
from tests.bridge.live.conftest import frames_file as frames_file
from tests.bridge.live.conftest import live_yaml as live_yaml
from tests.bridge.live.conftest import start as start
from tests.ros_domain import domain_id as domain_id
