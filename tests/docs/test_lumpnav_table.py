"""The table of docs/lumpnav.md: each control that it names is on the page or in the panel."""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from app.case import DISPLAY_ITEMS
from app.viewer.drawing.camera_controller import CameraPreset
from app.viewer.drawing.scene_view import PARTS

ROOT = Path(__file__).parents[2]
WEB = ROOT / "app" / "viewer" / "web"
UI = ROOT / "slicer_module" / "MarginGuard" / "Resources" / "UI" / "MarginGuard.ui"
REQUIRED = [
    "contour",
    "erase",
    "dilation",
    "hydromark",
    "needle",
    "bullseye",
    "ruler",
    "six",
    "CSV",
    "marks",
    "saved",
    "calibration",
    "freeze",
    "brightness",
    "depth",
    "mute",
    "centred",
    "events",
    "undo",
]
"""Words of the functions that the table has to list."""


def rows():
    """Cells of the table: function, page, panel, commands."""
    lines = (ROOT / "docs" / "lumpnav.md").read_text().splitlines()
    found = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if "|" in line]
    return [cells for cells in found if not cells[0].startswith(("LumpNav2", "---"))]


def labels(cell):
    return re.findall(r"(?<!\w)\*([^*]+)\*", cell)


@pytest.fixture(scope="module")
def page_labels():
    """Texts, tooltips and labels of the page's files, and those that come from Python."""
    text = "\n".join(
        path.read_text() for path in [*WEB.glob("*.js"), *WEB.glob("*.html")] if path.is_file()
    )
    named = re.findall(r'(?:title|aria-label)="([^"(]+)', text)
    written = [each.strip() for each in re.findall(r">([^<>{}]+)", text)]
    return {each.strip() for each in named} | set(written) | python_labels()


def python_labels():
    items = {each.heading for each in DISPLAY_ITEMS}
    return {each.value for each in CameraPreset} | set(PARTS.values()) | items


@pytest.fixture(scope="module")
def panel_labels():
    texts = ElementTree.parse(UI).getroot().iter("property")
    items = {each.heading for each in DISPLAY_ITEMS}
    return items | {each.findtext("string") for each in texts if each.get("name") == "text"}


def test_every_row_has_four_cells():
    assert [cells for cells in rows() if len(cells) != 4 or not all(cells)] == []
    assert len(rows()) > 40


@pytest.mark.parametrize("cells", rows(), ids=lambda cells: cells[0])
def test_named_controls_exist(cells, page_labels, panel_labels):
    assert [each for each in labels(cells[1]) if each not in page_labels] == []
    assert [each for each in labels(cells[2]) if each not in panel_labels] == []


def test_a_control_that_does_not_exist_is_found(page_labels, panel_labels):
    assert labels("*No such control*, *Brightness*") == ["No such control", "Brightness"]
    assert "No such control" not in page_labels | panel_labels
    assert "Brightness" not in panel_labels


@pytest.mark.parametrize("node", ["BreachMarkers", "ClosestPoints"])
def test_named_nodes_are_those_of_the_scene(node):
    source = ROOT / "app" / "scene" / "margin_display.py"
    assert f'= "{node}"' in source.read_text()
    assert any(f"`{node}`" in cells[2] for cells in rows())


@pytest.mark.parametrize("word", REQUIRED)
def test_function_of_lumpnav_has_a_row(word):
    assert any(word in cells[0] for cells in rows())
