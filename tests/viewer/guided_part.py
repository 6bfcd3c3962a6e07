"""A guided recording of the page, run by the page's commands."""

import threading
from types import SimpleNamespace

import pytest

from app.runtime import LocalOperator, compute_here
from app.viewer import LiveOperator
from app.viewer.address import Role
from app.viewer.guided_part import GuidedPart, add_guided_controls
from app.viewer.messages.checks import Commands, NotDoneError, RefusedError
from app.workflow import Workflow
from tests.waiting import wait_until


class GuidedPage:
    """The recording ``name`` with its commands, and the waiting for its fits.

    ``request`` gets the command that uses its result.
    """

    def __init__(self, name, content, request):
        self.computed = threading.Semaphore(0)
        operator = SimpleNamespace(request=request, compute=compute_here)
        self.workflow = Workflow(content, operator, self.computed.release)
        self.part = GuidedPart(self.workflow)
        self.guide = getattr(self.workflow, name)
        self.commands = Commands()
        add_guided_controls(self.commands, self.workflow)
        self._name, self._content = name, content

    @property
    def values(self):
        return self.part.values()[self._name]

    def run(self, name, *args, role=Role.OPERATE):
        self.commands.run(f"{self._name}_{name}", [self.values["revision"], *args], role)

    def finish(self):
        """Wait until what was recorded so far is fitted."""
        self.workflow.update(self._content)
        for _ in range(3):
            if self.guide.task() is None:
                return
            assert self.computed.acquire(timeout=60.0)
            self.workflow.update(self._content)
        raise AssertionError("not computed")

    def check_viewers_and_outdated_pages_are_refused(self, commands):
        """Each of ``commands``, given with its arguments, changes nothing for them."""
        for name, args in commands.items():
            with pytest.raises(RefusedError, match="role view; expected operate"):
                self.run(name, *args, role=Role.VIEW)
            with pytest.raises(NotDoneError, match="another page has changed it meanwhile"):
                self.commands.run(f"{self._name}_{name}", [77, *args], Role.OPERATE)


def must_not_be_used(*_):
    """Fail the test: a part that is not ready has sent something to the session."""
    pytest.fail("must not be used")


@pytest.fixture
def operator():
    """The operator of a page, who is not connected with a session yet."""
    operator = LiveOperator(lambda refused: pytest.fail(refused.text))
    yield operator
    operator.close()


def connect(operator, world):
    """Connect ``operator`` with the session of ``world``, as its page is."""
    operator.connect(LocalOperator(world.commands, "the page"))


def requested(world):
    """The request that ``world`` lists next."""
    commands = world.commands
    wait_until(lambda: commands.requests.last is not None, describe=lambda: "no request")
    return commands.requests.last
