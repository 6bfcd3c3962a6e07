"""The part of Slicer's application that a scene needs outside of desktop Slicer."""

from slicer import (
    vtkMRMLScene,
    vtkSlicerApplicationLogic,
    vtkSlicerMarkupsLogic,
    vtkSlicerSegmentationsModuleLogic,
    vtkSlicerSequencesLogic,
)
from vtkmodules.vtkCommonCore import vtkCollection


class SceneApplication:
    """Registers the logics of markups, segmentations and sequences for ``scene``.

    Create it before nodes are added to the scene, and keep it while a view of the scene is open.
    Desktop Slicer has these logics itself.
    """

    def __init__(self, scene: vtkMRMLScene) -> None:
        self.scene = scene
        self.logic = vtkSlicerApplicationLogic()
        self.logic.SetMRMLScene(scene)
        self.logic.SetViewLogics(vtkCollection())
        self.logic.SetSliceLogics(vtkCollection())
        # The application logic does not own it; without this reference no markup is drawn.
        self._markups = vtkSlicerMarkupsLogic()
        self._markups.SetMRMLScene(scene)
        self._markups.SetMRMLApplicationLogic(self.logic)
        self.logic.SetModuleLogic("Markups", self._markups)
        # Registers the conversion from a voxel segment to a surface.
        self._segmentations = vtkSlicerSegmentationsModuleLogic()
        self._segmentations.SetMRMLScene(scene)
        self._segmentations.SetMRMLApplicationLogic(self.logic)
        self.logic.SetModuleLogic("Segmentations", self._segmentations)
        # Plays sequences: moves the nodes of a sequence browser.
        self._sequences = vtkSlicerSequencesLogic()
        self._sequences.SetMRMLScene(scene)
        self._sequences.SetMRMLApplicationLogic(self.logic)
