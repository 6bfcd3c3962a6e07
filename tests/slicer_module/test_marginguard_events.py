"""Breaches, notes and directions of the tip in the panel."""

import numpy as np
import pytest

from app.fixture import MarginState
from app.geometry import InputError
from app.runtime import stop_surface
from app.session import AxisDistances
from tests.shipped_case import BREACHES, DEEP, middle_s
from tests.slicer_module.marginguard_module import CASE, CLEAR_S, node_of, show, spin_until
from tests.waiting import wait_until

pytestmark = pytest.mark.slow


@pytest.fixture
def panel_logic(replayed):
    return replayed


def test_all_breaches_of_a_recording_are_listed_and_shown(panel_logic):
    rows = panel_logic.events.breach_rows()
    assert len(rows) == len(BREACHES) == panel_logic.events.breaches.count == 3
    begins_s = [float(row[0].split()[0]) for row in rows]
    assert begins_s == pytest.approx([each["start_s"] for each in BREACHES], abs=0.3)
    deepest = [row for row in rows if row[1].endswith("(deepest)")]
    assert len(deepest) == 1
    assert {row[3] for row in rows} != {"tip"}  # one is by the shaft

    row = rows.index(deepest[0])
    panel_logic.events.go_to_breach(row)
    entry = panel_logic.events.breaches.deepest
    status = spin_until(panel_logic, lambda now: now.state is MarginState.POSITIVE)
    assert not status.is_playing
    step = panel_logic.session.shown_step
    assert step.frame.stamp.ns == entry.deepest_ns
    distance_mm = step.decision.proximity.signed_distance_mm
    assert distance_mm == pytest.approx(-entry.depth_mm, abs=1e-9)
    with pytest.raises(InputError, match="none is selected"):
        panel_logic.events.go_to_breach(len(rows))


def test_notes_are_on_moments_and_in_a_table_of_the_scene(panel_logic, application):
    with pytest.raises(InputError, match="0 characters"):
        panel_logic.events.add_note("  ")
    status = show(panel_logic, CLEAR_S)
    panel_logic.events.add_note("skin incision")
    ((time, text),) = panel_logic.events.note_rows()
    assert (time, text) == (f"{status.position_s:.1f} s", "skin incision")

    show(panel_logic, 0.0)
    panel_logic.events.go_to_note(0)
    spin_until(panel_logic, lambda now: now.position_s == status.position_s)
    with pytest.raises(InputError, match="none is selected"):
        panel_logic.events.go_to_note(1)

    panel_logic.events.to_table()
    table = node_of(application, "Events")
    assert table.GetNumberOfRows() == 4
    cells = [[table.GetCellText(row, column) for column in range(4)] for row in range(4)]
    assert cells[0] == [f"{status.position_s:.3f}", "note", "", "skin incision"]
    assert [row[1] for row in cells[1:]] == ["breach"] * 3
    depths_mm = [float(row[2]) for row in cells[1:]]
    assert max(depths_mm) == pytest.approx(panel_logic.events.breaches.deepest.depth_mm, abs=0.01)

    panel_logic.end_session()
    assert panel_logic.events.note_rows() == panel_logic.events.breach_rows() == ()
    assert application.scene.IsNodePresent(table)
    with pytest.raises(InputError, match="there is no step yet"):
        panel_logic.events.add_note("too late")
    with pytest.raises(InputError, match="events: there is none"):
        panel_logic.events.to_table()


def test_directions_are_those_of_the_surface_at_the_stop_margin(panel_logic):
    show(panel_logic, CLEAR_S)
    status = spin_until(panel_logic, lambda now: now.directions)
    content = panel_logic.session.started().content
    tip_mm = panel_logic.session.shown_step.tumor_from_tip.translation_mm
    found = AxisDistances(stop_surface(content)).at(tip_mm)
    words = status.directions.split()
    shown = dict(zip(words[::2], words[1::2], strict=True))
    assert shown.keys() == set("RLAPSI")
    for letter, text in shown.items():
        assert text == ("\N{EN DASH}" if found[letter] is None else f"{found[letter]:.1f}")

    panel_logic.set_margins(0.0, 5.0)
    panel_logic.step()
    spin_until(panel_logic, lambda now: now.position_s > status.position_s and now.directions)
    content = panel_logic.session.started().content
    tip_mm = panel_logic.session.shown_step.tumor_from_tip.translation_mm
    at_tumor = AxisDistances(content.tumor).at(tip_mm)
    words = panel_logic.refresh().directions.split()
    numbers = [float(text) for text in words[1::2] if text != "\N{EN DASH}"]
    expected = [each for each in at_tumor.values() if each is not None]
    np.testing.assert_allclose(sorted(numbers), sorted(expected), atol=0.051)


def test_widgets_list_events_and_jump(panel, opens_at_once, errors):
    ui, logic = panel.ui, panel.logic.panel_logic
    panel.refresh()
    assert not (ui.addNoteButton.isEnabled() or ui.goToBreachButton.isEnabled())
    assert (ui.breachLabel.text(), ui.breachTableWidget.rowCount()) == ("no breach", 0)
    logic.load_case(CASE)
    spin_until(logic, lambda now: now.position_s is not None)
    panel.refresh()
    assert ui.breachLabel.text().startswith("3 breaches so far, deepest ")
    assert ui.breachTableWidget.rowCount() == 3
    begins_s = [float(ui.breachTableWidget.item(n, 0).text().split()[0]) for n in range(3)]
    row = int(np.argmin([abs(each - DEEP["start_s"]) for each in begins_s]))
    ui.breachTableWidget.setCurrentCell(row, 0)
    ui.goToBreachButton.click()
    status = spin_until(logic, lambda now: now.state is MarginState.POSITIVE)
    assert abs(status.position_s - middle_s(DEEP)) < DEEP["end_s"] - DEEP["start_s"]
    panel.refresh()
    ui.noteLineEdit.setText("in the tumour")
    ui.addNoteButton.click()
    panel.refresh()
    assert ui.noteLineEdit.text() == ""
    assert ui.noteTableWidget.item(0, 1).text() == "in the tumour"
    ui.noteTableWidget.setCurrentCell(0, 1)
    ui.goToNoteButton.click()
    assert spin_until(logic, lambda now: now.position_s is not None).position_s > 0.0

    # The replay plays on: the step after one with directions may have none.
    wait_until(lambda: "A" in ui.directionsLabel.text(), panel.refresh)
    assert errors == []
