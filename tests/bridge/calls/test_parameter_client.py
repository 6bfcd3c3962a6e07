"""Parameters of another process."""

import queue

import numpy as np
import pytest

from app.bridge.calls import (
    CallError,
    ParameterClient,
    ParameterUnsetError,
    RefusedError,
    ServerUnavailableError,
)
from app.bridge.convert import ConversionError
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow


@pytest.fixture
def client(ros, peer):
    return ParameterClient(ros, "/peer")


def test_values_are_read(client):
    expected = {"gain": 1.5, "names": ("a", "b"), "table": (1, 2, 3), "level": 3}
    assert {name: client.get(name, timeout_s=DEADLINE_S) for name in expected} == expected


def test_unset_parameter_raises(client):
    for name in ("nothing", "blank"):
        with pytest.raises(ParameterUnsetError, match=f"/peer .*'{name}'"):
            client.get(name, timeout_s=DEADLINE_S)


def test_refused_values_have_the_nodes_reason(client):
    client.set(
        {"gain": 2.5, "names": ["x"], "table": np.array([], dtype=np.int64)}, timeout_s=DEADLINE_S
    )
    assert client.get("gain") == 2.5
    assert client.get("names") == ("x",)
    assert client.get("table") == ()
    with pytest.raises(RefusedError, match="gain: six is too loud; level: "):
        client.set({"gain": 6.0, "names": ["set"], "level": 4})
    assert [client.get(name) for name in ("gain", "names", "level")] == [2.5, ("set",), 3]


def test_parameter_changes_are_received(client, ros):
    changes = queue.Queue()
    client.watch(changes.put)
    client.get("gain", timeout_s=DEADLINE_S)
    # The other node may not have discovered the subscription yet.
    for value in range(1000):
        client.set({"arm.reach": float(value)})
        try:
            change = changes.get(timeout=0.05)
            break
        except queue.Empty:
            continue
    assert set(change.values) == {"arm.reach"}
    assert change.deleted == ()


def test_missing_node_and_empty_name_are_errors(ros):
    with pytest.raises(ServerUnavailableError, match="/missing/get_parameters"):
        ParameterClient(ros, "/missing").get("x", timeout_s=0.05)
    with pytest.raises(CallError, match="empty"):
        ParameterClient(ros, "/")


def test_invalid_parameter_values_are_refused(ros):
    client = ParameterClient(ros, "/missing")
    for value, message in (
        ([], "has no type"),
        ([1, "a"], "mixes types"),
        ({"a": 1}, "dict"),
        (2**63, "64-bit"),
        (np.zeros((2, 2)), "one dimension"),
    ):
        with pytest.raises(ConversionError, match=message):
            client.set({"x": value})
