"""Constraints that a session publishes, received through the API in another process's domain."""

import itertools
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import marginguard as mg
from app.bridge import SessionPublisher
from app.runtime import SessionContent, StepTiming
from app.session import StepResult
from tests.bridge.conftest import content as content
from tests.bridge.conftest import make_step as make_step
from tests.ros_domain import domain_id as domain_id
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.slow

MakeStep = Callable[..., StepResult]


@pytest.fixture
def publish(domain_id: int, content: SessionContent):
    """Publishes a step once a subscriber of its constraint is known."""
    from app.bridge.topics import CONSTRAINT

    with SessionPublisher(content, heartbeat_hz=None) as publisher:

        def send(step: StepResult) -> None:
            assert publisher.ros.wait_for_subscribers(CONSTRAINT, 1, 60.0)
            publisher.publish(step, StepTiming())

        yield send


def test_constraint_arrives_in_millimetres(publish, make_step):
    step = make_step(3)
    with mg.constraint_stream(timeout_s=60.0) as constraints:
        publish(step)
        received = constraints.read()
    assert isinstance(received, mg.ReceivedConstraint)
    sent, decision = step.decision.constraint, step.decision
    assert received.constraint is not None and sent is not None
    np.testing.assert_allclose(received.constraint.rows, sent.rows, atol=1e-9)
    assert (received.constraint.frame, received.hold) == ("tumor", False)
    assert received.state is mg.MarginState.NEGATIVE
    assert received.reasons == ("clear",)
    assert received.signed_distance_mm == pytest.approx(7.5)
    assert received.lower_bound_mm == pytest.approx(7.25)
    assert received.stop_total_mm == pytest.approx(1.75)
    assert received.warn_total_mm == pytest.approx(5.75)
    assert decision.stamp is not None
    assert received.stamp_ns == decision.stamp.ns
    assert received.valid_until_ns == decision.stamp.ns + 200_000_000


def test_unknown_numbers_are_none_and_hold_is_kept(publish, make_step):
    with mg.constraint_stream(timeout_s=60.0) as constraints:
        publish(make_step(0, lost=True))
        received = next(iter(constraints))
    assert received.state is mg.MarginState.UNKNOWN
    assert received.reasons == ("invalid", "latched")
    assert received.hold
    assert received.constraint is not None and received.constraint.hold
    assert received.signed_distance_mm is None
    assert received.stop_total_mm is None


def test_each_constraint_is_read_once(publish, make_step):
    with mg.constraint_stream(timeout_s=60.0) as constraints:
        publish(make_step(0))
        assert constraints.read().seq == 0
        with pytest.raises(mg.MarginGuardError, match=r"no constraint in 0\.1 s; .* is silent"):
            constraints.read(timeout_s=0.1)
        publish(make_step(1))
        assert constraints.read().seq == 1


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"state": 9}, "state is 9; expected 0 to 3"),
        ({"hold": False}, "no half-spaces and no hold"),
    ],
)
def test_invalid_message_is_an_error(domain_id, change, problem):
    from marginguard_msgs.msg import FixtureConstraint

    from app.bridge import RosNode
    from app.bridge.topics import CONSTRAINT

    with RosNode("marginguard") as ros, mg.constraint_stream(timeout_s=60.0) as constraints:
        publisher = ros.publisher(CONSTRAINT)
        assert ros.wait_for_subscribers(CONSTRAINT, 1, 60.0)
        publisher.publish(FixtureConstraint(**{"hold": True, "state": 3, **change}))
        with pytest.raises(mg.MarginGuardError, match=problem):
            constraints.read()


def test_second_publisher_is_an_error_until_it_has_left(domain_id):
    """`read` does not wait for its timeout, neither for the error nor for a constraint after it."""
    from marginguard_msgs.msg import FixtureConstraint

    from app.bridge import RosNode
    from app.bridge.constraint_message import DEFAULT_TOPIC
    from app.bridge.topics import CONSTRAINT, Topic

    def repeat(ros: RosNode, ended: threading.Event) -> None:
        publisher = ros.publisher(Topic(DEFAULT_TOPIC, FixtureConstraint, CONSTRAINT.qos))
        for seq in itertools.count():
            message = FixtureConstraint(seq=seq, hold=True, state=3)
            message.instance_id = ros.node.get_name()
            publisher.publish(message)
            if ended.wait(0.02):
                return

    def is_read() -> bool:
        try:
            return constraints.read().instance_id == "stays"
        except mg.MarginGuardError as error:
            assert "/marginguard/constraint: 2 publishers send (node" in str(error)
            return False

    ends = threading.Event(), threading.Event()
    with (
        RosNode("stays") as stays,
        mg.constraint_stream(timeout_s=DEADLINE_S) as constraints,
        ThreadPoolExecutor() as senders,
    ):
        try:
            senders.submit(repeat, stays, ends[0])
            assert is_read()
            with RosNode("leaves") as leaves:
                sending = senders.submit(repeat, leaves, ends[1])
                wait_until(lambda: not is_read())
                ends[1].set()
                sending.result()
            wait_until(is_read)
        finally:
            for each in ends:
                each.set()


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ({"topic": 3}, "topic: is 3; expected the name of a topic"),
        ({"topic": "no spaces"}, "topic 'no spaces' cannot be used"),
        ({"timeout_s": -1.0}, "timeout_s: is -1.0; expected seconds > 0"),
    ],
)
def test_wrong_arguments_are_named(domain_id, arguments, problem):
    with pytest.raises(mg.MarginGuardError, match=problem):
        mg.read_constraint(**arguments)
