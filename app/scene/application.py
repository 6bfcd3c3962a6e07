"""The part of Slicer's application that a scene needs where there is no desktop Slicer."""

from slicer import (
    vtkMRMLScene,
    vtkSlicerApplicationLogic,
    vtkSlicerMarkupsLogic,
    vtkSlicerSegmentationsModuleLogic,
    vtkSlicerSequencesLogic,
)
from vtkmodules.vtkCommonCore import vtkCollection


class SceneApplication:
    """Makes ``scene`` know markups, segments, sequences and views; no other scene is touched.

    Make it before anything is put into the scene, keep it while a view of the scene is open.
    Inside desktop Slicer it is not needed: there the application has all of this.
    """

    def __init__(self, scene: vtkMRMLScene) -> None:
        self.scene = scene
        self.logic = vtkSlicerApplicationLogic()
        self.logic.SetMRMLScene(scene)
        self.logic.SetViewLogics(vtkCollection())
        self.logic.SetSliceLogics(vtkCollection())
        # The application logic does not own it: without this reference no markup would be drawn.
        self._markups = vtkSlicerMarkupsLogic()
        self._markups.SetMRMLScene(scene)
        self._markups.SetMRMLApplicationLogic(self.logic)
        self.logic.SetModuleLogic("Markups", self._markups)
        # It brings the rules by which a segment of voxels gets a surface.
        self._segmentations = vtkSlicerSegmentationsModuleLogic()
        self._segmentations.SetMRMLScene(scene)
        self._segmentations.SetMRMLApplicationLogic(self.logic)
        self.logic.SetModuleLogic("Segmentations", self._segmentations)
        # Plays sequences: it moves the nodes that a browser node says.
        self._sequences = vtkSlicerSequencesLogic()
        self._sequences.SetMRMLScene(scene)
        self._sequences.SetMRMLApplicationLogic(self.logic)
