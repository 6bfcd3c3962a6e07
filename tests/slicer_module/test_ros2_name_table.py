"""The table of ros2_names.txt: each name exists, and the test named there uses it."""

import ast
import re
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.slicer_module.test_ros2_names import NAMES

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).parent
PAGE = FOLDER / "ros2_names.txt"
HEADING = "## Every name and its test"
JUDGES = ("rclpy", "rclpy, scene file", "class")


def rows():
    """Cells of the table: classes, names, meaning, test, judge."""
    text = PAGE.read_text().split(HEADING)[1].split("\n## ")[0]
    lines = [line for line in text.splitlines() if line.startswith("| `")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def quoted(cell):
    return re.findall(r"`([^`]+)`", cell)


@cache
def functions(stem):
    """Functions and classes of a test file by name."""
    tree = ast.parse((FOLDER / f"{stem}.py").read_text())
    kinds = (ast.FunctionDef, ast.ClassDef)
    return {each.name: each for each in tree.body if isinstance(each, kinds)}


def used_by(stem, name, found):
    """Add to ``found`` the source of a test and of all fixtures and helpers that it uses."""
    for file in (stem, "conftest"):
        node = functions(file).get(name)
        if node is None or (file, name) in found:
            continue
        found[file, name] = ast.unparse(node)
        words = {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}
        words |= {each.arg for each in ast.walk(node) if isinstance(each, ast.arg)}
        for word in words:
            used_by(stem, word, found)
    return found


@pytest.fixture(scope="module")
def classes():
    from ROS2Lib.class_names import register_classes
    from ROS2Lib.logic import Ros2Api
    from ROS2Lib.topic_nodes import vtkMRMLROS2PublisherCollisionObjectNode

    made = SimpleNamespace(
        Ros2Api=Ros2Api,
        vtkMRMLROS2PublisherCollisionObjectNode=vtkMRMLROS2PublisherCollisionObjectNode,
    )
    register_classes(made)
    return made


@pytest.mark.parametrize("row", rows(), ids=lambda row: quoted(row[3])[0].rpartition("::")[2])
def test_names_of_a_row_exist_and_are_used_by_its_test(classes, row):
    owners, names, _, test, judge = row
    for owner in quoted(owners):
        assert [name for name in quoted(names) if not hasattr(getattr(classes, owner), name)] == []
    stem, _, function = quoted(test)[0].partition("::")
    assert function in functions(stem), f"{stem} has no {function}"
    found = used_by(stem, function, {})
    text = "\n".join(source for (file, _), source in found.items() if file != "conftest")
    assert [name for name in quoted(names) if not re.search(rf"\b{name}\b", text)] == []
    assert judge in JUDGES
    if "rclpy" in judge:
        assert ("conftest", "peer") in found
    if "scene file" in judge:
        assert ".mrml" in text


def test_every_public_name_has_a_row():
    known = {(each, name) for row in rows() for each in quoted(row[0]) for name in quoted(row[1])}
    required = {(owner, name) for owner, names in NAMES.items() for name in names.split()}
    assert sorted(required - known) == []


def test_stated_counts_are_those_of_the_table():
    counts = dict.fromkeys(JUDGES, 0)
    for owners, names, _, _, judge in rows():
        counts[judge] += len(quoted(owners)) * len(quoted(names))
    stated = re.search(
        r"(\d+) names: (\d+) against rclpy, (\d+) against rclpy and a scene file, (\d+) of",
        PAGE.read_text(),
    )
    assert [int(each) for each in stated.groups()] == [sum(counts.values()), *counts.values()]
