"""Foxglove's npm packages and rosbags decode the same messages from the results of a replay.

`make test-foxglove` runs it: it needs node, and the packages that `npm ci` fetches. Without them it
fails instead of being skipped.
"""

import json
import math
import subprocess
from collections import Counter
from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from app.cli.main import main

HERE = Path(__file__).resolve().parent
PACKAGES = HERE / "node_modules"
CASE = "package://marginguard/recorded_case"

Read = tuple[str, int, str, Any]
"""Topic, time in ns, type, message."""


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bag") / "results"
    assert main(["replay", CASE, "--no-ros", "--mcap", str(folder)]) == 0
    return folder


def by_rosbags(folder: Path) -> Iterator[Read]:
    """The messages as rosbags decodes them, topic by topic in the order of their names."""
    with Reader(folder) as reader:
        store = get_typestore(Stores.EMPTY)
        for connection in reader.connections:
            store.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
        for topic in sorted({connection.topic for connection in reader.connections}):
            chosen = [each for each in reader.connections if each.topic == topic]
            for connection, time_ns, data in reader.messages(chosen):
                message = store.deserialize_cdr(data, connection.msgtype)
                yield topic, time_ns, connection.msgtype, message


def by_foxglove(file: Path) -> Iterator[Read]:
    """The messages as Foxglove's packages decode them, in the same order."""
    assert PACKAGES.is_dir(), f"{PACKAGES} is missing: run make test-foxglove"
    command = ["node", str(HERE / "read_bag.mjs"), str(file)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            topic, time_ns, schema, message = json.loads(line, object_hook=number)
            yield topic, time_ns, schema, message
    assert process.returncode == 0


def number(value: dict[str, Any]) -> Any:
    """A number that JSON cannot hold, as `read_bag.mjs` writes it; other objects as they are."""
    if len(value) != 1:
        return value
    if "int" in value:
        return int(value["int"])
    return float(value["float"]) if "float" in value else value


@cache
def names_of(kind: type) -> frozenset[str]:
    """The fields of a message; what has a default is a constant, or the name of the type."""
    return frozenset(each.name for each in fields(kind) if each.default is MISSING)


def differences(found: Any, expected: Any, place: str = "") -> list[str]:
    """Places at which ``found`` of Foxglove is not exactly ``expected`` of rosbags."""
    if is_dataclass(expected):
        names = names_of(type(expected))
        if names == {"structure_needs_at_least_one_member"}:
            return [] if found == {} else [f"{place}: {found}"]
        if not isinstance(found, dict) or found.keys() != names:
            return [f"{place}: {found}; expected the fields {sorted(names)}"]
        return [
            each
            for name in sorted(names)
            for each in differences(found[name], getattr(expected, name), f"{place}.{name}")
        ]
    if isinstance(expected, np.ndarray):
        expected = expected.tolist()
    if isinstance(expected, list):
        if not isinstance(found, list) or len(found) != len(expected):
            return [f"{place}: {found}; expected {len(expected)} values"]
        if all(map(same, found, expected)):  # numbers; their places take most of the time
            return []
        return [
            each
            for index, (a, b) in enumerate(zip(found, expected, strict=True))
            for each in differences(a, b, f"{place}[{index}]")
        ]
    return [] if same(found, expected) else [f"{place}: {found!r}; expected {expected!r}"]


def same(found: Any, expected: Any) -> bool:
    """Equal in value and, of a float, in sign; NaN is NaN. JSON writes 1.0 as 1. No lists."""
    if isinstance(expected, float) and isinstance(found, int | float):
        if math.isnan(expected):
            return math.isnan(found)
        return found == expected and math.copysign(1.0, found) == math.copysign(1.0, expected)
    return type(found) is type(expected) is not list and bool(found == expected)


def test_foxglove_reads_the_messages_that_rosbags_reads(bag):
    (file,) = bag.glob("*.mcap")
    counts: Counter[str] = Counter()
    for found, expected in zip_longest(by_foxglove(file), by_rosbags(bag)):
        assert found is not None and expected is not None
        assert found[:3] == expected[:3]
        assert differences(found[3], expected[3]) == [], (found[0], found[1])
        counts[found[0]] += 1
    with Reader(bag) as reader:
        assert counts == Counter({topic: info.msgcount for topic, info in reader.topics.items()})
    assert counts["/marginguard/margin_mm"] > 5000
    assert {"/marginguard/constraint", "/marginguard/markers", "/tf", "/tf_static"} <= set(counts)
    print(*(f"{count:6d} {topic}" for topic, count in sorted(counts.items())), sep="\n")


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (1, 2),
        (1.0, 1.0000000000000002),
        (0.0, -0.0),
        (1.0, float("nan")),
        (1, True),
        ("a", "b"),
        ([1, 2], np.array([1, 3])),
        ([1], np.array([1, 1])),
        ([[0.0]], [[-0.0]]),
    ],
)
def test_a_difference_is_found(found, expected):
    assert len(differences(found, expected)) == 1
    equal = expected.tolist() if isinstance(expected, np.ndarray) else expected
    assert differences(equal, expected) == []
