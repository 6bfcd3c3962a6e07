"""Settings of the panel in the module's parameter node, saved with the scene."""

import pathlib
from typing import Annotated, Union

from slicer import (
    vtkMRMLLinearTransformNode,
    vtkMRMLMarkupsClosedCurveNode,
    vtkMRMLMarkupsFiducialNode,
    vtkMRMLModelNode,
    vtkMRMLSegmentationNode,
)
from slicer.parameterNodeWrapper import Choice, Default, WithinRange, parameterNodeWrapper

FROM_CASE = "recorded case"
FROM_LANDMARKS = "landmarks in the scene"


@parameterNodeWrapper
class Settings:
    """Each is bound to the widget whose ``SlicerParameterName`` is its name; lengths in mm.

    ``fixed_points``: landmarks in the scene, in the reference; ``moving_points``: the same ones in
    coordinates of the robot's base. ``contour_error_mm``: standard deviation of a point of the
    contour, 0 where it is not stated. ``hydromark_mm``: radius of a marked clip, 0 for points on
    the tumour's surface. ``rate``: recorded time over clock time.
    """

    live_config: pathlib.Path
    replay_case: pathlib.Path
    registration_source: Annotated[str, Choice([FROM_CASE, FROM_LANDMARKS]), Default(FROM_CASE)]
    registration_case: pathlib.Path
    fixed_points: vtkMRMLMarkupsFiducialNode
    moving_points: vtkMRMLMarkupsFiducialNode
    # Slicer's wrapper supports typing.Union only, with None among its types.
    tumor: Union[  # noqa: UP007
        vtkMRMLModelNode,
        vtkMRMLSegmentationNode,
        vtkMRMLMarkupsFiducialNode,
        vtkMRMLMarkupsClosedCurveNode,
        None,
    ]
    segment: str
    dilation_mm: Annotated[float, WithinRange(0.0, 20.0), Default(0.0)]
    hydromark_mm: Annotated[float, WithinRange(0.0, 20.0), Default(0.0)]
    contour_error_mm: Annotated[float, WithinRange(0.0, 5.0), Default(0.0)]
    opacity: Annotated[float, WithinRange(0.0, 1.0), Default(0.4)]
    marker_spacing_mm: Annotated[float, WithinRange(0.2, 20.0), Default(1.0)]
    marker_size_mm: Annotated[float, WithinRange(0.2, 10.0), Default(1.4)]
    stop_mm: Annotated[float, WithinRange(0.0, 100.0), Default(1.0)]
    warn_mm: Annotated[float, WithinRange(0.0, 200.0), Default(5.0)]
    patient_to_ras: vtkMRMLLinearTransformNode
    rate: Annotated[float, WithinRange(0.05, 20.0), Default(1.0)]
