"""Each display item: all that follows from its declaration."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from app.case import DISPLAY_ITEMS, Case, ItemKind
from app.case.manifest.case_file import CASE, read_manifest
from app.files.document import Section
from app.geometry import InputError, Transform
from app.runtime import ITEM_COMMANDS, LocalOperator, ShownItem, tool_names
from app.runtime.display_items import items_of
from app.runtime.operator_command import COMMANDS
from app.runtime.requests import ADMITTED
from app.viewer.drawing.scene_view import PARTS
from app.viewer.page_values import item_values
from tests.runtime.command_world import World
from tests.valid_documents import shipped

TIP = Transform("sensor", "sensor_tip", np.eye(3), [0.0, 0.0, 60.0])
MATRIX = TIP.matrix.ravel().tolist()
KEYS = {
    ItemKind.ROD: {"frame": "sensor", "length_mm": 60.0},
    ItemKind.POINTER: {"frame": "sensor", "tip_from": {"matrix": MATRIX}, "sigma_mm": 0.2},
}
EVERY_ITEM = pytest.mark.parametrize("item", DISPLAY_ITEMS, ids=lambda item: item.name)


def read(**items):
    values = {key: value for key, value in shipped("case").items() if key not in ITEM_COMMANDS}
    return read_manifest(Section(values | items, "case.yaml:", CASE))


@EVERY_ITEM
def test_item_of_a_case_is_drawn_from_sensor_to_tip_and_changed_by_its_command(item):
    (shown,) = items_of(Case(Path(), read(**{item.name: KEYS[item.kind]}), None))
    assert (shown.declared, shown.surface.frame) == (item, "sensor_tip")
    np.testing.assert_allclose(shown.tip.matrix, TIP.matrix)
    assert np.ptp(shown.surface.vertices_mm[:, 2]) == 60.0
    world, command = World(items=(shown,)), ITEM_COMMANDS[item.name]
    longer = Transform("sensor", "sensor_tip", np.eye(3), [0.0, 0.0, 65.0])
    arguments = (5.0,) if item.kind is ItemKind.ROD else (longer, 0.3)
    LocalOperator(world.commands, "a test").request(command(*arguments))
    world.assert_only_shown_content_changed()
    content = world.commands.content
    assert content.item(item.name).tip.translation_mm.tolist() == [0.0, 0.0, 65.0]
    assert content.replaced_since(world.content) == (item.name,)
    assert world.commands.requests.last.kind == item.command
    # The keys for a recorded case are read back as the same item.
    keys = KEYS[item.kind] | content.values(world.content).items[item.name]
    (recorded,) = items_of(Case(Path(), read(**{item.name: keys}), None))
    np.testing.assert_array_equal(recorded.tip.matrix, longer.matrix)
    (row,) = item_values(SimpleNamespace(content=content))["display_items"]
    assert (row["name"], row["command"]) == (item.name, item.command)


@pytest.mark.parametrize(
    "direction",
    [(0.6, 0.0, 0.8), (0.0, -0.8, 0.6), (-0.6, 0.64, 0.48), (0.6, 0.64, -0.48), (0.0, 0.0, -1.0)],
)
def test_rod_points_along_its_direction(direction):
    name = next(item.name for item in DISPLAY_ITEMS if item.kind is ItemKind.ROD)
    keys = KEYS[ItemKind.ROD] | {"tip_from": {"direction": list(direction)}}
    (shown,) = items_of(Case(Path(), read(**{name: keys}), None))
    np.testing.assert_allclose(shown.tip.translation_mm, 60.0 * np.array(direction), atol=1e-9)
    np.testing.assert_allclose(shown.tip.rotation[:, 2], direction, atol=1e-12)
    assert np.linalg.det(shown.tip.rotation) == pytest.approx(1.0)


@EVERY_ITEM
def test_every_item_has_a_command_with_a_limit_and_is_a_part_or_a_tool(item):
    assert COMMANDS[item.command] is ITEM_COMMANDS[item.name]
    assert item.command in ADMITTED and not ITEM_COMMANDS[item.name].loosens
    is_rod = item.kind is ItemKind.ROD
    assert (item.name.upper() in PARTS, item.name in tool_names()) == (is_rod, not is_rod)


@EVERY_ITEM
def test_item_in_the_frame_of_the_tool_is_refused(item):
    keys = KEYS[item.kind] | {"frame": read().tool.frame}
    with pytest.raises(InputError, match=rf"{item.name}\.frame is .*, the frame of the tool; exp"):
        read(**{item.name: keys})


def test_names_colours_and_commands_of_items_differ():
    for field in ("name", "title", "color", "command", "model_name"):
        assert len({getattr(each, field) for each in DISPLAY_ITEMS}) == len(DISPLAY_ITEMS)


def test_item_that_is_not_declared_is_refused():
    with pytest.raises(
        InputError, match=r"^display item: is .rod.; expected one of needle, stylus"
    ):
        ShownItem("rod", "sensor")
