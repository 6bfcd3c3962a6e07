"""TEST DOUBLE for `qt`, `ctk` and the qMRML widgets of desktop Slicer, based on PySide6.

Desktop Slicer uses Qt through PythonQt, which is not available elsewhere. This double supports the
parts of PythonQt that MarginGuard.py uses:

=================================================  =============================================
``button.clicked.connect(f)``                      signals as attributes
``label.setText(s)``, ``button.setEnabled(b)``,    Qt's slots and public methods
``setChecked``, ``setValue``, ``setStyleSheet``,
``blockSignals``, ``underMouse``, ``setInterval``
``widget.setProperty("maximum", x)``               properties by name, for CTK's widgets
``path.filters = ctk.ctkPathLineEdit.Dirs``,       properties and enums as attributes
``path.currentPath``
``widget.name``                                    the object's name, for slicer.util
``panel.setMRMLScene(scene)``                      slots of qMRML's widgets
``qt.QTimer()``, ``qt.QSocketNotifier``,           classes of Qt without their modules
``qt.QLabel(s)``, ``qt.QPushButton(s)``,
``qt.QTableWidgetItem(s)``, ``qt.QHBoxLayout()``,
``qt.QPixmap``, ``qt.QPainter``, pens, brushes
``qt.QApplication.beep()``
=================================================  =============================================

The ``.ui`` file is the real one. A widget class, property, signal or slot that the classes below do
not have raises `UnknownInUiError`. They have members of the real classes only.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

from PySide6 import QtCore, QtGui, QtUiTools, QtWidgets
from PySide6.QtCore import Property


class UnknownInUiError(Exception):
    """The .ui file uses a class or member that this double does not have."""


class Signal:
    """Signal of one widget, instead of PySide6's.

    ``emit`` in PySide6 6.12 returns True without a new reference to it, so that Python 3.11 finally
    aborts.
    """

    def __init__(self, widget: QtCore.QObject) -> None:
        self._widget = widget
        self._slots: list[Callable[[Any], object]] = []

    def connect(self, slot: Callable[[Any], object]) -> None:
        self._slots.append(slot)

    def disconnect(self, slot: Callable[[Any], object]) -> None:
        self._slots.remove(slot)

    def emit(self, value: Any) -> None:
        if not self._widget.signalsBlocked():
            for slot in tuple(self._slots):
                slot(value)


class ctkCollapsibleButton(QtWidgets.QGroupBox):  # noqa: N801
    def __init__(self, parent: QtWidgets.QWidget | None = None) -> None:
        super().__init__(parent)
        self._collapsed = False

    _TITLE_PX = 26

    text = Property(str, QtWidgets.QGroupBox.title, QtWidgets.QGroupBox.setTitle)

    def _set_collapsed(self, collapsed: bool) -> None:
        self._collapsed = collapsed
        self.hide_content()

    def hide_content(self) -> None:
        """Hide what a collapsed section contains; called when it is complete, too."""
        for child in self.findChildren(
            QtWidgets.QWidget, options=QtCore.Qt.FindChildOption.FindDirectChildrenOnly
        ):
            child.setVisible(not self._collapsed)
        self.setMaximumHeight(self._TITLE_PX if self._collapsed else 16777215)

    collapsed = Property(bool, lambda self: self._collapsed, _set_collapsed)


class ctkPathLineEdit(QtWidgets.QLineEdit):  # noqa: N801
    """Emits a path change only for an existing path, like the real widget."""

    NATIVE: ClassVar[set[str]] = {"currentPathChanged(QString)"}
    Dirs, Files = 0x001, 0x002

    def __init__(self, parent: QtWidgets.QWidget | None = None) -> None:
        super().__init__(parent)
        self.currentPathChanged = Signal(self)
        self._filters = 0
        self.textChanged.connect(self._on_text)

    def _on_text(self, text: str) -> None:
        path = Path(text)
        if path.is_file() if self._filters & self.Files else path.is_dir():
            self.currentPathChanged.emit(text)

    currentPath = Property(str, QtWidgets.QLineEdit.text, QtWidgets.QLineEdit.setText)  # noqa: N815

    def _set_filters(self, filters: int) -> None:
        self._filters = filters

    filters = Property(int, lambda self: self._filters, _set_filters)


class ctkSliderWidget(QtWidgets.QWidget):  # noqa: N801
    """Slider with 1000 steps and a label of its value."""

    NATIVE: ClassVar[set[str]] = {"valueChanged(double)", "setValue(double)"}
    _STEPS = 1000

    def __init__(self, parent: QtWidgets.QWidget | None = None) -> None:
        super().__init__(parent)
        self.valueChanged = Signal(self)
        self._minimum, self._maximum, self._value = 0.0, 99.0, 0.0
        self._decimals, self._suffix, self._single_step = 2, "", 1.0
        self._tracking = True
        self._slider = QtWidgets.QSlider(QtCore.Qt.Orientation.Horizontal)
        self._slider.setMaximum(self._STEPS)
        self._text = QtWidgets.QLabel()
        layout = QtWidgets.QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self._slider)
        layout.addWidget(self._text)

    def setValue(self, value: float) -> None:  # noqa: N802
        value = min(max(value, self._minimum), self._maximum)
        changed, self._value = value != self._value, value
        span = self._maximum - self._minimum
        self._slider.setValue(round(self._STEPS * (value - self._minimum) / span) if span else 0)
        self._text.setText(f"{value:.{self._decimals}f}{self._suffix}")
        if changed:
            self.valueChanged.emit(value)

    def _setter(name: str) -> Callable[["ctkSliderWidget", Any], None]:  # noqa: N805
        def set_property(self: "ctkSliderWidget", value: Any) -> None:
            setattr(self, name, value)
            self.setValue(self._value)

        return set_property

    value = Property(float, lambda self: self._value, setValue)
    minimum = Property(float, lambda self: self._minimum, _setter("_minimum"))
    maximum = Property(float, lambda self: self._maximum, _setter("_maximum"))
    singleStep = Property(float, lambda self: self._single_step, _setter("_single_step"))  # noqa: N815
    decimals = Property(int, lambda self: self._decimals, _setter("_decimals"))
    suffix = Property(str, lambda self: self._suffix, _setter("_suffix"))
    tracking = Property(bool, lambda self: self._tracking, _setter("_tracking"))


class qMRMLWidget(QtWidgets.QWidget):  # noqa: N801
    NATIVE: ClassVar[set[str]] = {"mrmlSceneChanged(vtkMRMLScene*)", "setMRMLScene(vtkMRMLScene*)"}

    def __init__(self, parent: QtWidgets.QWidget | None = None) -> None:
        super().__init__(parent)
        self.mrmlSceneChanged = Signal(self)

    def setMRMLScene(self, scene: Any) -> None:  # noqa: N802
        self.mrmlSceneChanged.emit(scene)


class qMRMLNodeComboBox(QtWidgets.QComboBox):  # noqa: N801
    """Node selector; its list contains only the current node."""

    NATIVE: ClassVar[set[str]] = {
        "currentNodeChanged(vtkMRMLNode*)",
        "setMRMLScene(vtkMRMLScene*)",
        "setCurrentNode(vtkMRMLNode*)",
    }

    def __init__(self, parent: QtWidgets.QWidget | None = None) -> None:
        super().__init__(parent)
        self.currentNodeChanged = Signal(self)
        self.scene: Any = None
        self._node: Any = None
        self._types: list[str] = []
        self._flags: dict[str, bool] = {}

    def setMRMLScene(self, scene: Any) -> None:  # noqa: N802
        self.scene = scene

    def currentNode(self) -> Any:  # noqa: N802
        return self._node

    def setCurrentNode(self, node: Any) -> None:  # noqa: N802
        if node is not None:
            assert self.scene is not None and self.scene.IsNodePresent(node), "not in the scene"
            subclasses = self._flags.get("showChildNodeTypes", True)
            assert any(
                node.GetClassName() == kind or (subclasses and node.IsA(kind))
                for kind in self._types
            ), f"{node.GetClassName()} is not among the node types"
        changed, self._node = node is not self._node, node
        self.clear()
        self.addItem("None" if node is None else node.GetName())
        if changed:
            self.currentNodeChanged.emit(node)

    def _set_types(self, types: list[str]) -> None:
        self._types = list(types)

    def _flag(name: str) -> Property:  # noqa: N805
        return Property(
            bool,
            lambda self: self._flags.get(name, False),
            lambda self, value: self._flags.__setitem__(name, value),
        )

    nodeTypes = Property("QStringList", lambda self: self._types, _set_types)  # noqa: N815
    noneEnabled = _flag("noneEnabled")  # noqa: N815
    addEnabled = _flag("addEnabled")  # noqa: N815
    removeEnabled = _flag("removeEnabled")  # noqa: N815
    showHidden = _flag("showHidden")  # noqa: N815
    showChildNodeTypes = _flag("showChildNodeTypes")  # noqa: N815


CUSTOM = {
    each.__name__: each
    for each in (
        ctkCollapsibleButton,
        ctkPathLineEdit,
        ctkSliderWidget,
        qMRMLWidget,
        qMRMLNodeComboBox,
    )
}


class QUiLoader(QtUiTools.QUiLoader):
    """Loads the real .ui with the classes above; raises `UnknownInUiError`."""

    def __init__(self) -> None:
        super().__init__()
        self._made: dict[str, QtWidgets.QWidget] = {}
        self._refused = ""

    def createWidget(self, kind: str, parent: Any = None, name: str = "") -> QtWidgets.QWidget:  # noqa: N802
        made = CUSTOM.get(kind) or (
            getattr(QtWidgets, kind, None) if kind in self.availableWidgets() else None
        )
        if made is None:
            self._refused = f"{name}: widget class {kind} is not known"
            made = QtWidgets.QWidget
        widget = made(parent)
        widget.setObjectName(name)
        widget.name = name
        self._made[name] = widget
        return widget

    def load(self, file: QtCore.QFile) -> QtWidgets.QWidget:
        root = ElementTree.fromstring(bytes(file.readAll().data()))
        connections = root.find("connections")
        if connections is not None:
            root.remove(connections)
        buffer = QtCore.QBuffer()
        buffer.setData(ElementTree.tostring(root))
        buffer.open(QtCore.QBuffer.OpenModeFlag.ReadOnly)
        panel = super().load(buffer)
        if self._refused:
            raise UnknownInUiError(self._refused)
        for element in root.iter("widget"):
            self._check_properties(element)
        for made in self._made.values():
            if isinstance(made, ctkCollapsibleButton):
                made.hide_content()
        for connection in connections if connections is not None else ():
            self._connect(connection)
        panel.made = self._made  # Python objects of the widgets by name
        return panel

    def _check_properties(self, element: ElementTree.Element) -> None:
        meta = self._made[element.get("name", "")].metaObject()
        for given in element.findall("property"):
            name = given.get("name", "")
            if given.get("stdset") != "0" and meta.indexOfProperty(name) < 0:
                raise UnknownInUiError(f"{element.get('name')}: {meta.className()} has no {name!r}")

    def _connect(self, connection: ElementTree.Element) -> None:
        ends = []
        for end, what in (("sender", "signal"), ("receiver", "slot")):
            widget = self._made[connection.findtext(end, "")]
            signature = connection.findtext(what, "")
            if signature not in getattr(type(widget), "NATIVE", ()):
                raise UnknownInUiError(f"{widget.name}: {what} {signature} is not known")
            ends.append(getattr(widget, signature.split("(")[0]))
        ends[0].connect(ends[1])


class QApplication(QtWidgets.QApplication):
    beeps = 0

    @staticmethod
    def beep() -> None:
        QApplication.beeps += 1


qt = SimpleNamespace(
    QApplication=QApplication,
    QBrush=QtGui.QBrush,
    QColor=QtGui.QColor,
    QHBoxLayout=QtWidgets.QHBoxLayout,
    QFile=type("QFile", (QtCore.QFile,), {"ReadOnly": QtCore.QFile.OpenModeFlag.ReadOnly}),
    QIcon=QtGui.QIcon,
    QLabel=QtWidgets.QLabel,
    QPainter=QtGui.QPainter,
    QPen=QtGui.QPen,
    QPixmap=QtGui.QPixmap,
    QPushButton=QtWidgets.QPushButton,
    QSocketNotifier=QtCore.QSocketNotifier,
    QTableWidgetItem=QtWidgets.QTableWidgetItem,
    QTimer=QtCore.QTimer,
    QUiLoader=QUiLoader,
    QVBoxLayout=QtWidgets.QVBoxLayout,
    QWidget=QtWidgets.QWidget,
)
ctk = SimpleNamespace(
    ctkCollapsibleButton=ctkCollapsibleButton,
    ctkPathLineEdit=ctkPathLineEdit,
    ctkSliderWidget=ctkSliderWidget,
)
