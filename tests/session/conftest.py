"""Robot, case and set-ups that the tests of sessions share."""

from itertools import islice

import pytest

from app.case import open_case
from app.robot import load_robot
from app.session import setup_from_case
from app.synthetic.motion import TOUCH_URDF


@pytest.fixture(scope="session")
def touch():
    return load_robot(TOUCH_URDF)


@pytest.fixture(scope="session")
def case(project_root):
    return open_case(project_root / "data" / "recorded_case")


@pytest.fixture(scope="session")
def case_setup(case):
    """The set-up of the recorded case, with the tip of the tool alone."""
    return setup_from_case(case, tip_only=True)


@pytest.fixture(scope="session")
def case_frames(case):
    """The first 200 frames of the recorded case."""
    return list(islice(case.frames(), 200))
