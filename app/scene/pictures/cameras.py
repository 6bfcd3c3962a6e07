"""Where to look from: the usual directions, and along the tool. Points and directions in RAS, mm.

Pure functions from poses to a `Camera`; `look_through` applies one to a view's camera node.
"""

from enum import Enum

import numpy as np
from slicer import vtkMRMLCameraNode

from app.geometry import FloatArray, SurfaceMesh, Transform
from app.scene.errors import SceneError
from app.scene.pictures.framing import Camera, fit

VIEW_ANGLE_DEG = 30.0


class Preset(Enum):
    """A side of the patient to look from; the value is the direction from the patient to it."""

    ANTERIOR = (0.0, 1.0, 0.0)
    POSTERIOR = (0.0, -1.0, 0.0)
    LEFT = (-1.0, 0.0, 0.0)
    RIGHT = (1.0, 0.0, 0.0)
    SUPERIOR = (0.0, 0.0, 1.0)
    INFERIOR = (0.0, 0.0, -1.0)


def preset_camera(
    preset: Preset,
    points: FloatArray,
    *,
    ras_from_patient: FloatArray | None = None,
    angle_deg: float = VIEW_ANGLE_DEG,
    aspect: float = 1.0,
) -> Camera:
    """From the side ``preset``, all of ``points`` (n, 3) in the picture, superior up.

    From above and below, anterior is up. ``ras_from_patient`` (3, 3) turns the sides where the
    patient's axes are not those of RAS. ``angle_deg`` and ``aspect`` as for `fit`.
    """
    turn = np.eye(3) if ras_from_patient is None else ras_from_patient
    towards = np.array(preset.value)
    above = Preset.ANTERIOR if preset in (Preset.SUPERIOR, Preset.INFERIOR) else Preset.SUPERIOR
    up = np.array(above.value)
    return fit(points, turn @ towards, turn @ up, angle_deg=angle_deg, aspect=aspect)


def bullseye(
    ras_from_tip: Transform,
    forward: FloatArray,
    *,
    distance_mm: float,
    previous_up: FloatArray | None = None,
) -> Camera:
    """Along the tool: from ``distance_mm`` behind its tip, the tip in the middle of the picture.

    ``forward`` (3,) points along the shaft towards the tip and beyond, in the tip's frame
    (`forward_of`). The tool's own axes give what is up, so that the picture turns with the hand;
    with ``previous_up`` (3,) that of the last picture is kept as far as it can be.
    """
    length = float(np.linalg.norm(forward))
    if not (length > 0.0 and np.isfinite(length)) or not distance_mm > 0.0:
        raise SceneError(
            f"forward {np.asarray(forward).tolist()} at {distance_mm:g} mm gives no view along a "
            "tool: a direction and a distance above 0 wanted"
        )
    along = np.asarray(forward, dtype=np.float64) / length
    tip = ras_from_tip.translation_mm
    direction = ras_from_tip.rotate(along)
    wanted = ras_from_tip.rotate(_across(along)) if previous_up is None else previous_up
    up = wanted - (wanted @ direction) * direction
    size = float(np.linalg.norm(up))
    if size < 1e-6:  # the last up lies along the tool now
        up = ras_from_tip.rotate(_across(along))
        size = float(np.linalg.norm(up))
    return Camera(tip - distance_mm * direction, tip.copy(), up / size)


def forward_of(tool: SurfaceMesh) -> FloatArray:
    """The unit direction (3,) from the middle of ``tool`` to its tip, the origin of its frame."""
    middle = 0.5 * np.sum(tool.bounds_mm, axis=0)
    length = float(np.linalg.norm(middle))
    if length < 1e-6:
        raise SceneError("the tool's mesh lies around its tip: it has no direction to look along")
    return np.asarray(-middle / length)


def look_through(node: vtkMRMLCameraNode, camera: Camera, angle_deg: float) -> None:
    """Put the camera node of a view there; its observers are told once."""
    modifying = node.StartModify()
    node.SetPosition(camera.position.tolist())
    node.SetFocalPoint(camera.focal_point.tolist())
    node.SetViewUp(camera.up.tolist())
    node.SetViewAngle(angle_deg)
    node.ResetClippingRange()
    node.EndModify(modifying)


def _across(along: FloatArray) -> FloatArray:
    """A unit vector (3,) across ``along``: the coordinate axis that leans least, straightened."""
    axis = np.zeros(3)
    axis[int(np.argmin(np.abs(along)))] = 1.0
    across = axis - (axis @ along) * along
    return np.asarray(across / np.linalg.norm(across))
