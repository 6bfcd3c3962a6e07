"""The part of Slicer's application that a scene needs where there is no desktop Slicer."""

from slicer import vtkMRMLScene, vtkSlicerApplicationLogic, vtkSlicerMarkupsLogic
from vtkmodules.vtkCommonCore import vtkCollection


class SceneApplication:
    """Makes ``scene`` know markups and views; the program's other scenes are not touched.

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
