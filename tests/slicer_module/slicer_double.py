"""TEST DOUBLE for the parts of desktop Slicer's Python that the wheels do not contain.

``slicer.ScriptedLoadableModule``, ``slicer.parameterNodeWrapper``, ``slicer.mrmlScene``; the scene,
its nodes and ``slicer.util`` are the real ones. The double contains only what our modules use.
It reproduces these properties of Slicer's wrapper:

- a union of node classes without None cannot have its default None (TypeError);
- a node class is instantiated once for its class name, so an abstract one cannot be bound;
- a value out of its range or choices raises ValueError, one of another type TypeError;
- ``connectGui`` returns no tag, and without a tag ``disconnectGui`` disconnects nothing;
- a widget that rounds a displayed value does not write the rounded value back.
"""

import pathlib
import typing
import unittest
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import slicer
from PySide6 import QtWidgets
from vtkmodules.vtkCommonCore import vtkCommand

from tests.slicer_module.qt_double import (
    ctk,
    ctkPathLineEdit,
    ctkSliderWidget,
    qMRMLNodeComboBox,
    qMRMLWidget,
    qt,
)


class ScriptedLoadableModule:
    def __init__(self, parent: Any) -> None:
        self.parent = parent


class ScriptedLoadableModuleWidget:
    """``parent`` is a qMRMLWidget with a layout and the path of the module, as in Slicer."""

    def __init__(self, parent: Any) -> None:
        super().__init__()
        self.parent = parent
        self.layout = parent.layout()

    def resourcePath(self, name: str) -> str:  # noqa: N802
        return str(self.parent.folder / "Resources" / name)

    def setup(self) -> None:
        """Slicer adds its developer section here."""


class ScriptedLoadableModuleLogic:
    def getParameterNode(self) -> Any:  # noqa: N802
        scene, name = slicer.mrmlScene, type(self).__name__.removesuffix("Logic")
        node = scene.GetSingletonNode(name, "vtkMRMLScriptedModuleNode")
        if node is None:
            node = slicer.vtkMRMLScriptedModuleNode()
            node.SetSingletonTag(name)
            node.SetModuleName(name)
            node = scene.AddNode(node)
        return node


class ScriptedLoadableModuleTest(unittest.TestCase):
    def delayDisplay(self, text: str) -> None:  # noqa: N802
        """Slicer shows ``text`` briefly."""


def panel_parent(folder: Path) -> qMRMLWidget:
    """The parent that Slicer passes to a module's widget."""
    parent = qMRMLWidget()
    QtWidgets.QVBoxLayout(parent)
    parent.folder = folder
    return parent


@dataclass(frozen=True)
class Default:
    value: Any


@dataclass(frozen=True)
class Choice:
    choices: list[Any]


@dataclass(frozen=True)
class WithinRange:
    minimum: float
    maximum: float


@dataclass(frozen=True)
class _Parameter:
    """A parameter's name, its plain type (a tuple of classes for nodes), and its annotations."""

    name: str
    kind: Any
    notes: tuple[Any, ...]
    allows_none: bool = False

    def note(self, kind: type) -> Any:
        """The first annotation that is an instance of ``kind``, or None."""
        return next((note for note in self.notes if isinstance(note, kind)), None)

    @property
    def is_node(self) -> bool:
        return isinstance(self.kind, tuple)

    def default(self) -> Any:
        given = self.note(Default)
        if given is not None:
            return given.value
        return None if self.is_node else self.kind()

    def read(self, node: Any) -> Any:
        if not node.HasParameter(self.name):  # like Slicer's wrapper, store the default
            self.write(node, self.default())
        if self.is_node:
            return node.GetNodeReference(self.name)
        return self.kind(node.GetParameter(self.name))

    def write(self, node: Any, value: Any) -> None:
        if not (isinstance(value, self.kind) or (value is None and self.allows_none)):
            raise TypeError(f"{self.name}: unable to write {value!r}")
        if self.is_node:
            node.SetParameter(self.name, "")
            node.SetNodeReferenceID(self.name, None if value is None else value.GetID())
            return
        choice, limits = self.note(Choice), self.note(WithinRange)
        if choice is not None and value not in choice.choices:
            raise ValueError(f"{self.name}: {value!r}; expected one of {choice.choices}")
        if limits is not None and not limits.minimum <= value <= limits.maximum:
            raise ValueError(f"{self.name}: {value!r}; expected a value within {limits}")
        node.SetParameter(self.name, str(value))


def _parameter(name: str, hint: Any) -> _Parameter:
    notes: tuple[Any, ...] = ()
    if typing.get_origin(hint) is typing.Annotated:
        hint, *rest = typing.get_args(hint)
        notes = tuple(rest)
    union = typing.get_origin(hint) is typing.Union
    nodes = tuple(kind for kind in typing.get_args(hint) if kind is not type(None))
    kinds = nodes if union else (hint,)
    if all(issubclass(kind, slicer.vtkMRMLNode) for kind in kinds):
        return _Parameter(name, kinds, notes, not union or type(None) in typing.get_args(hint))
    if hint not in (str, float, pathlib.Path):
        raise TypeError(f"{name}: the double does not support {hint} in a parameter node")
    return _Parameter(name, hint, notes)


class _Binding:
    """Connection of a widget and a parameter, for the pairs that Slicer's connectors support."""

    def __init__(self, widget: Any, parameter: _Parameter, node: Any) -> None:
        self.widget, self.parameter, self.node = widget, parameter, node
        kind = type(widget)
        if parameter.is_node and kind is qMRMLNodeComboBox:
            widget.setProperty("nodeTypes", [each().GetClassName() for each in parameter.kind])
            self.changed = widget.currentNodeChanged
            self.read, self.write = widget.currentNode, widget.setCurrentNode
        elif parameter.kind is pathlib.Path and kind is ctkPathLineEdit:
            self.changed = widget.currentPathChanged
            self.read = lambda: pathlib.Path(widget.currentPath)
            self.write = lambda value: widget.setProperty("currentPath", str(value))
        elif parameter.kind is str and kind is QtWidgets.QLineEdit:
            self.changed, self.read, self.write = widget.textChanged, widget.text, widget.setText
        elif parameter.kind is str and kind is QtWidgets.QComboBox and parameter.note(Choice):
            widget.clear()
            widget.addItems(parameter.note(Choice).choices)
            self.changed, self.read = widget.currentIndexChanged, widget.currentText
            self.write = widget.setCurrentText
        elif parameter.kind is float and kind in (QtWidgets.QDoubleSpinBox, ctkSliderWidget):
            limits = parameter.note(WithinRange)
            if limits is None:
                raise RuntimeError(f"{parameter.name}: {kind.__name__} expects a range")
            widget.setProperty("minimum", limits.minimum)
            widget.setProperty("maximum", limits.maximum)
            self.changed, self.write = widget.valueChanged, widget.setValue
            self.read = lambda: widget.property("value")
        else:
            raise RuntimeError(f"{kind.__name__} cannot display {parameter.name}: {parameter.kind}")
        self.write(parameter.read(node))
        self.changed.connect(self.store)

        self.following = False

    def store(self, *_: Any) -> None:
        if not self.following:
            self.parameter.write(self.node, self.read())

    def follow(self) -> None:
        value = self.parameter.read(self.node)
        self.following = True
        try:
            if self.read() != value:
                self.write(value)
        finally:
            self.following = False

    def close(self) -> None:
        self.changed.disconnect(self.store)


def parameter_node_wrapper_class(classtype: type) -> type:
    """Convert an annotated class into one whose attributes are stored in a parameter node."""
    hints = typing.get_type_hints(classtype, include_extras=True)
    parameters = {name: _parameter(name, hint) for name, hint in hints.items()}

    def init(self: Any, node: Any) -> None:
        self.parameterNode, self._bindings = node, {}
        for parameter in parameters.values():
            parameter.read(node)

    def connect_parameters(self: Any, widgets: dict[str, Any]) -> int:
        tag = len(self._bindings)
        self._bindings[tag] = [
            _Binding(widget, parameters[name], self.parameterNode)
            for name, widget in widgets.items()
        ]

        def follow(*_: Any) -> None:
            for each in self._bindings.get(tag, ()):
                each.follow()

        self.parameterNode.AddObserver(vtkCommand.ModifiedEvent, follow)
        return tag

    def connect_gui(self: Any, gui: Any) -> None:
        named = ((each.property("SlicerParameterName"), each) for each in vars(gui).values())
        connect_parameters(self, {name: widget for name, widget in named if name})

    def disconnect_gui(self: Any, tag: int | None) -> None:
        for each in self._bindings.pop(tag, ()):
            each.close()

    def attribute(parameter: _Parameter) -> property:
        return property(
            lambda self: parameter.read(self.parameterNode),
            lambda self, value: parameter.write(self.parameterNode, value),
        )

    members = {name: attribute(parameter) for name, parameter in parameters.items()}
    members |= {
        "__init__": init,
        "connectGui": connect_gui,
        "connectParametersToGui": connect_parameters,
        "disconnectGui": disconnect_gui,
    }
    return type(classtype.__name__, (), members | {"__doc__": classtype.__doc__})


def _module(name: str, **members: Any) -> ModuleType:
    module = ModuleType(name)
    vars(module).update(members)
    return module


scripted_loadable_module = _module(
    "slicer.ScriptedLoadableModule",
    ScriptedLoadableModule=ScriptedLoadableModule,
    ScriptedLoadableModuleWidget=ScriptedLoadableModuleWidget,
    ScriptedLoadableModuleLogic=ScriptedLoadableModuleLogic,
    ScriptedLoadableModuleTest=ScriptedLoadableModuleTest,
)
parameter_node_wrapper = _module(
    "slicer.parameterNodeWrapper",
    Choice=Choice,
    Default=Default,
    WithinRange=WithinRange,
    parameterNodeWrapper=parameter_node_wrapper_class,
)


def stand_ins() -> dict[str, Any]:
    """All replaced modules of desktop Slicer, by name."""
    return {
        "qt": qt,
        "ctk": ctk,
        "slicer.ScriptedLoadableModule": scripted_loadable_module,
        "slicer.parameterNodeWrapper": parameter_node_wrapper,
    }
