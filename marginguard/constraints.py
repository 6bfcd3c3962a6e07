"""Constraints: limit a twist, and read what a session publishes on ROS."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from app.fixture import Constraint, LimiterParameters, limit_twist
from app.geometry import InputError
from app.runtime import ReceivedConstraint
from marginguard.arguments import needs

if TYPE_CHECKING:
    from app.bridge.constraint_reader import ConstraintReader

__all__ = [
    "Constraint",
    "LimiterParameters",
    "ReceivedConstraint",
    "constraint_stream",
    "limit_twist",
    "read_constraint",
]

DEFAULT_TOPIC = "/marginguard/constraint"


def read_constraint(topic: str = DEFAULT_TOPIC, *, timeout_s: float = 5.0) -> ReceivedConstraint:
    """Wait for one constraint of a running session and return it, in mm.

    Joins the ROS graph and leaves it again, which takes about a second: use `constraint_stream` for
    more than one. Stays on this machine unless ``ROS_AUTOMATIC_DISCOVERY_RANGE`` is set. Needs the
    extra ``ros``. Raises `InputError` without it, `BridgeError` (a `MarginGuardError`) if none
    arrives in ``timeout_s`` and for a topic that cannot be used.

    >>> import marginguard as mg
    >>> mg.read_constraint("/no/such/session", timeout_s=0.1)
    Traceback (most recent call last):
        ...
    app.bridge.errors.BridgeError: /no/such/session: no constraint in 0.1 s; it has no publisher ...
    """
    with constraint_stream(topic, timeout_s=timeout_s) as constraints:
        return constraints.read()


@contextmanager
def constraint_stream(
    topic: str = DEFAULT_TOPIC, *, timeout_s: float = 5.0
) -> "Iterator[ConstraintReader]":
    """Subscribe to the constraints of a session while the ``with`` block runs.

    ``for received in constraints`` yields each new one, ``constraints.read()`` the newest that has
    not been read. Both raise as `read_constraint` when none arrives in ``timeout_s``. A slow reader
    misses constraints; it never gets an old one.

    >>> import marginguard as mg
    >>> with mg.constraint_stream("/no/such/session") as constraints:
    ...     constraints.read(timeout_s=0.1)
    Traceback (most recent call last):
        ...
    app.bridge.errors.BridgeError: /no/such/session: no constraint in 0.1 s; it has no publisher ...
    """
    if not isinstance(topic, str):
        raise InputError(f"topic: is {topic!r}; expected the name of a topic as str")
    with needs("ROS 2"):
        from app.bridge import prepare_environment
        from app.bridge.constraint_reader import ConstraintReader
    prepare_environment()
    with ConstraintReader(topic, timeout_s=timeout_s) as reader:
        yield reader
