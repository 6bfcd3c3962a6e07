"""The page takes the colours and hatches of the states from `app.fixture`, and has no copies."""

import re
from pathlib import Path

import pytest

from app.fixture import MarginState
from app.viewer.timeline import band_patterns, state_css

WEB = Path("app/viewer/web")


@pytest.mark.parametrize("state", MarginState)
def test_style_sheet_has_the_colors_of_each_state(state):
    name = state.name.lower()
    css = state_css()
    assert f"--{name}: {state.display.color_hex};" in css
    assert f"--on-{name}: {state.display.text_color_hex};" in css
    assert f'.state[data-state="{state.name}"]' in css


def test_files_of_the_page_hold_no_copy_of_a_color_or_label(project_root):
    for path in sorted((project_root / WEB).iterdir()):
        text = path.read_text("utf-8").lower()
        for state in MarginState:
            assert state.display.color_hex not in text, path.name
        assert not re.search(r"--(negative|warning|positive|unknown)\s*:", text), path.name
        assert "in tumour" not in text, path.name


def test_bands_have_the_hatch_that_the_plots_have():
    patterns = {entry["state"]: entry["path"] for entry in band_patterns()}
    assert set(patterns) == {state.name for state in MarginState if state.display.hatch}
    assert len(set(patterns.values())) == len(patterns)
