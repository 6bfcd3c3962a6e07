"""The registration on the page: from touched points to the session's registration, by commands."""

from itertools import islice

import pytest

from app.case import open_case
from app.runtime import SetRegistration, content_of
from app.session import Session, setup_from_case
from app.viewer.messages.checks import NotDoneError, RefusedError
from tests.cut_case import recorded_frames
from tests.runtime.test_operator_commands import World
from tests.shipped_case import SHIPPED_CASE
from tests.viewer.guided_part import GuidedPage, connect, must_not_be_used, requested
from tests.viewer.guided_part import operator as operator

pytestmark = pytest.mark.slow

FRAMES = 380
"""Up to the end of the last of 8 dwells of the shipped case, every second frame."""


@pytest.fixture(scope="module")
def case():
    """The shipped case at 20 Hz, with its set-up."""
    case = open_case(SHIPPED_CASE, frames=recorded_frames(0.0, 20.0)[::2])
    return case, setup_from_case(case, tip_only=True)


class Registering(GuidedPage):
    """A registration on the page that observes the shipped case."""

    def __init__(self, case, request):
        self.case, self.setup = case
        content = content_of(*case, tip_only=True)
        super().__init__("registration", content, request)

    def observe(self, frames=FRAMES):
        session = Session(self.setup)
        for frame in islice(self.case.frames(), frames):
            self.guide.observe(session.step(frame))


def test_points_with_their_errors_become_the_registration(case):
    used = []
    registering = Registering(case, lambda command: used.append(command.registration) or True)
    assert registering.values["count"] == ""
    registering.run("start", "cautery")
    registering.observe()
    registering.finish()
    values = registering.values
    assert values["count"] == "recording, 8 points"
    assert values["verdict"].startswith("Good enough: predicted TRE")
    assert [each["number"] for each in values["points"]] == list(range(1, 9))
    assert all(0.0 < float(each["residual"]) < 0.5 for each in values["points"])
    registering.run("stop")
    registering.finish()
    registering.run("remove", registering.values["points"][2]["id"])
    registering.finish()
    assert len(registering.values["points"]) == 7
    assert registering.values["can_restore"]
    registering.run("restore")
    registering.finish()
    registering.run("use")
    assert len(used) == 1
    assert used[0].accepted
    assert len(used[0].residuals_mm) == 8


def test_few_points_are_not_used_and_say_why(case):
    registering = Registering(case, must_not_be_used)
    registering.run("start", "cautery")
    registering.observe(50)
    registering.run("stop")
    registering.finish()
    assert registering.values["verdict"] == "Not accepted: 1 points; expected at least 4"
    assert registering.values["advice"].startswith("Hold the tip still for 1 s at each point")
    with pytest.raises(NotDoneError, match="1 points; expected at least 4"):
        registering.run("use")
    registering.run("discard")
    assert not registering.values["points"]


def test_viewers_outdated_pages_and_wrong_points_change_nothing(case):
    registering = Registering(case, must_not_be_used)
    registering.check_viewers_and_outdated_pages_are_refused(
        {"start": ["cautery"], "remove": ["12"]}
        | {name: [] for name in ("stop", "discard", "restore", "use", "undo")}
    )
    for point in ("-1", "1e9", "", "\u0661"):
        with pytest.raises(RefusedError, match="expected its decimal number"):
            registering.run("remove", point)
    with pytest.raises(RefusedError, match="expected one of cautery, stylus"):
        registering.run("start", "needle")
    with pytest.raises(NotDoneError, match="stylus: the session has none; expected 'stylus' in"):
        registering.run("start", "stylus")
    assert registering.values["revision"] == 0


def test_operator_sends_a_registration_to_the_session(operator):
    world = World()
    command = SetRegistration(world.commands.content.registration)
    assert not operator.request(command)
    connect(operator, world)
    assert operator.request(command)
    request = requested(world)
    assert (request.kind, request.accepted, request.origin) == ("register", True, "the page")
