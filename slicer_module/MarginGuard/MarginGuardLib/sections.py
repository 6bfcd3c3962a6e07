"""The widgets of the panel by its parts."""

from collections.abc import Sequence
from typing import Any

import qt
import slicer

from app.case import DISPLAY_ITEMS, DisplayItem, ItemKind
from app.runtime import ShownItem
from app.scene import Preset
from app.session import structure_title

from .contour import ContourShown
from .events import SessionEvents
from .guided_section import GuidedSection
from .plan_section import PlanSection
from .status import PanelStatus
from .ultrasound import UltrasoundShown
from .view import PanelView
from .widgets import OnClick, ToolChoice, fill_table


class ContourSection:
    """Connects the buttons, and shows the contour."""

    def __init__(self, ui: Any, on_click: OnClick) -> None:
        self._ui = ui
        self._tool = ToolChoice(ui.tipToolComboBox)
        on_click(ui.placePointsButton, lambda logic: logic.contour.place())
        on_click(ui.tipPointButton, lambda logic: logic.contour.add_tip(self._tool.tool))
        on_click(ui.eraseAtTipButton, self._erase)
        on_click(ui.undoPointButton, lambda logic: logic.contour.undo())
        on_click(ui.deletePointsButton, self._delete_all)
        on_click(ui.useContourButton, self._use)

    def show(self, shown: ContourShown, tools: Sequence[str]) -> None:
        """Show ``shown`` and the ``tools`` that may be chosen."""
        ui = self._ui
        self._tool.show(tools)
        ui.contourLabel.setText(shown.text)
        ui.placePointsButton.setEnabled(shown.can_edit)
        ui.tipPointButton.setEnabled(shown.can_edit)
        ui.eraseAtTipButton.setEnabled(shown.has_points)
        ui.undoPointButton.setEnabled(shown.can_undo)
        ui.deletePointsButton.setEnabled(shown.has_points)
        ui.useContourButton.setEnabled(shown.can_use)

    def _erase(self, logic: Any) -> None:
        logic.contour.erase_at_tip(self._ui.eraseRadiusSpinBox.property("value"))

    def _delete_all(self, logic: Any) -> None:
        if slicer.util.confirmOkCancelDisplay("Delete all points of the contour?"):
            logic.contour.delete_all()

    def _use(self, logic: Any) -> None:
        if slicer.util.confirmOkCancelDisplay(
            "Replace the tumour of this session by the contour? "
            "The robot is held until an operator re-arms."
        ):
            logic.contour.use()


class EventsSection:
    """Connects the buttons, and shows the lists."""

    def __init__(self, ui: Any, on_click: OnClick) -> None:
        self._ui = ui
        breaches, notes = ui.breachTableWidget, ui.noteTableWidget
        on_click(
            ui.goToBreachButton, lambda logic: logic.events.go_to_breach(breaches.currentRow())
        )
        on_click(ui.goToNoteButton, lambda logic: logic.events.go_to_note(notes.currentRow()))
        on_click(ui.addNoteButton, self._add_note)
        on_click(ui.eventsTableButton, lambda logic: logic.events.to_table())

    def show(self, events: SessionEvents, *, has_session: bool, is_replay: bool) -> None:
        """Show what ``events`` lists now."""
        ui = self._ui
        breaches, notes = events.breach_rows(), events.note_rows()
        ui.breachLabel.setText(events.breaches.text or "no breach")
        fill_table(ui.breachTableWidget, breaches)
        fill_table(ui.noteTableWidget, notes)
        ui.goToBreachButton.setEnabled(is_replay and bool(breaches))
        ui.goToNoteButton.setEnabled(is_replay and bool(notes))
        ui.addNoteButton.setEnabled(has_session)
        ui.eventsTableButton.setEnabled(bool(breaches or notes))

    def _add_note(self, logic: Any) -> None:
        logic.events.add_note(self._ui.noteLineEdit.property("text"))
        self._ui.noteLineEdit.setText("")


class ItemsSection:
    """A row for each rod among the display items: its length, and buttons that change it."""

    def __init__(self, ui: Any, on_click: OnClick) -> None:
        self._rows = {
            item.name: _add_row(ui.itemsWidget.layout(), item, on_click)
            for item in DISPLAY_ITEMS
            if item.kind is ItemKind.ROD
        }

    def show(self, items: Sequence[ShownItem], *, is_live: bool) -> None:
        """Show the lengths of ``items`` in mm."""
        lengths = {each.name: each.text for each in items}
        for name, (label, buttons) in self._rows.items():
            label.setText(lengths.get(name, f"no {name}"))
            for button in buttons:
                button.setEnabled(is_live and name in lengths)


def _add_row(layout: Any, item: DisplayItem, on_click: OnClick) -> tuple[Any, list[Any]]:
    row, label, buttons = qt.QHBoxLayout(), qt.QLabel(), []
    label.setToolTip("From the sensor to the tip; no distance depends on it")
    row.addWidget(label)
    for by_mm in (-5.0, -1.0, 1.0, 5.0):
        button = qt.QPushButton(f"{by_mm:+g}")
        button.setMaximumWidth(48)
        change = "longer" if by_mm > 0.0 else "shorter"
        button.setToolTip(f"{item.title} {abs(by_mm):g} mm {change}")
        on_click(button, lambda logic, by_mm=by_mm: logic.items.lengthen(item.name, by_mm))
        row.addWidget(button)
        buttons.append(button)
    layout.addRow(item.heading, row)
    return label, buttons


class StructureSection:
    """Guards a structure beside the tumour no more, with a reason, or again; after a question."""

    def __init__(self, ui: Any, on_click: OnClick) -> None:
        self._ui = ui
        self._structures: tuple[tuple[str, bool], ...] = ()
        on_click(ui.switchStructureButton, self._switch)

    def show(self, structures: tuple[tuple[str, bool], ...], *, is_live: bool) -> None:
        """Show the names of ``structures``, and whether each is guarded."""
        ui = self._ui
        if structures != self._structures:
            self._structures = structures
            ui.structureComboBox.clear()
            for name, is_guarded in structures:
                title = structure_title(name)
                ui.structureComboBox.addItem(title if is_guarded else f"{title}, off")
        for widget in (ui.structureComboBox, ui.structureReasonLineEdit, ui.switchStructureButton):
            widget.setEnabled(is_live and bool(structures))

    def _switch(self, logic: Any) -> None:
        index = self._ui.structureComboBox.property("currentIndex")
        if not 0 <= index < len(self._structures):
            return
        name, is_guarded = self._structures[index]
        title = structure_title(name)
        question = f"{title}: guard it again?"
        if is_guarded:
            question = f"{title}: guard it no more? The robot is held until an operator re-arms."
        if slicer.util.confirmOkCancelDisplay(question):
            reason = self._ui.structureReasonLineEdit.property("text")
            logic.switch_structure(name, not is_guarded, reason)
            self._ui.structureReasonLineEdit.setText("")


class UltrasoundSection:
    """Connects the buttons, and shows the image's state and the depths."""

    def __init__(self, ui: Any, on_click: OnClick) -> None:
        self._ui = ui
        self._shown = UltrasoundShown()
        self._depths: tuple[float, ...] | None = None
        on_click(
            ui.freezeImageButton,
            lambda logic: logic.ultrasound.freeze(ui.freezeImageButton.property("checked")),
        )
        on_click(
            ui.followImageButton,
            lambda logic: logic.ultrasound.follow(ui.followImageButton.property("checked")),
        )
        on_click(ui.useDepthButton, self._use_depth)

    def show(self, shown: UltrasoundShown) -> None:
        """Show ``shown``."""
        ui, self._shown = self._ui, shown
        ui.imageLabel.setText(shown.text)
        ui.freezeImageButton.setEnabled(shown.has_images)
        ui.freezeImageButton.setChecked(shown.is_frozen)
        ui.followImageButton.setEnabled(shown.has_images)
        ui.followImageButton.setChecked(shown.follows)
        used = "one" if shown.depth_mm is None else f"{shown.depth_mm:g} mm"
        ui.depthLabel.setText(used if shown.has_images else "")
        if shown.depths_mm != self._depths:
            self._depths = shown.depths_mm
            ui.depthComboBox.clear()
            for depth_mm in shown.depths_mm:
                ui.depthComboBox.addItem(f"{depth_mm:g} mm")
        can_choose = shown.can_choose and bool(shown.depths_mm)
        ui.depthComboBox.setEnabled(can_choose)
        ui.useDepthButton.setEnabled(can_choose)

    def _use_depth(self, logic: Any) -> None:
        index = self._ui.depthComboBox.property("currentIndex")
        if not 0 <= index < len(self._shown.depths_mm):
            return
        depth_mm = self._shown.depths_mm[index]
        if slicer.util.confirmOkCancelDisplay(
            f"Use the depth {depth_mm:g} mm? Images that are stamped from now on are placed by its "
            "calibration. The ultrasound machine has to be at this depth."
        ):
            logic.ultrasound.choose_depth(depth_mm)


class ViewSection:
    """Connects the buttons, and shows which camera follows."""

    def __init__(self, ui: Any, on_click: OnClick) -> None:
        self._ui = ui
        on_click(ui.anteriorViewButton, lambda logic: logic.view.look_from(Preset.ANTERIOR))
        on_click(ui.leftViewButton, lambda logic: logic.view.look_from(Preset.LEFT))
        on_click(ui.rightViewButton, lambda logic: logic.view.look_from(Preset.RIGHT))
        on_click(ui.superiorViewButton, lambda logic: logic.view.look_from(Preset.SUPERIOR))
        on_click(
            ui.bullseyeButton,
            lambda logic: logic.view.follow_tool(ui.bullseyeButton.property("checked")),
        )
        on_click(
            ui.centreButton,
            lambda logic: logic.view.keep_centred(ui.centreButton.property("checked")),
        )
        on_click(ui.deleteMarkersButton, lambda logic: logic.view.delete_markers())

    def show(self, view: PanelView, status: PanelStatus) -> None:
        """Show what ``view`` follows, and the activation of ``status``."""
        self._ui.bullseyeButton.setChecked(view.follows_tool)
        self._ui.centreButton.setChecked(view.keeps_tumor)
        self._ui.deleteMarkersButton.setEnabled(status.has_session)
        self._ui.activationLabel.setText(status.activation)


class Sections:
    """Connects and shows all of them."""

    def __init__(self, ui: Any, on_click: OnClick) -> None:
        self._guided = GuidedSection(ui, on_click)
        self._events = EventsSection(ui, on_click)
        self._contour = ContourSection(ui, on_click)
        self._items = ItemsSection(ui, on_click)
        self._structures = StructureSection(ui, on_click)
        self._ultrasound = UltrasoundSection(ui, on_click)
        self._plans = PlanSection(ui, on_click)

    def show(self, status: PanelStatus, events: SessionEvents) -> None:
        """Show ``status`` and what ``events`` lists now."""
        self._guided.show(status)
        self._contour.show(status.contour, status.tools)
        self._items.show(status.items, is_live=status.is_live)
        self._structures.show(status.structures, is_live=status.is_live)
        self._ultrasound.show(status.ultrasound)
        self._plans.show(status.plans)
        self._events.show(
            events,
            has_session=status.has_session and bool(status.workflow),
            is_replay=status.position_s is not None,
        )
