"""The fixtures of live sessions, for tests in other folders."""

from tests.bridge.conftest import DEADLINE_S as DEADLINE_S
from tests.bridge.conftest import Child as Child
from tests.bridge.conftest import Start as Start
from tests.bridge.conftest import StartReceiver as StartReceiver
from tests.bridge.conftest import breach as breach
from tests.bridge.conftest import frames_file as frames_file
from tests.bridge.conftest import live_yaml as live_yaml
from tests.bridge.conftest import start as start
from tests.bridge.conftest import start_receiver as start_receiver
