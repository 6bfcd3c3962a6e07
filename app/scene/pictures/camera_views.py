"""Cameras at the sides of the patient and along the tool. Points and directions in RAS, mm.

Pure functions from poses to a `Camera`; `look_through` applies one to a view's camera node.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

import numpy as np
from slicer import vtkMRMLCameraNode

from app.geometry import FloatArray, SurfaceMesh, Transform
from app.scene.offscreen import SceneError

_AZIMUTHS = 24
_ELEVATIONS_DEG = (10.0, 25.0, 40.0)
_OCCLUSION_WEIGHT = 3.0
_SPACE_FACTOR = 1.06
"""Free space around the content, as a factor of the distance."""
VIEW_ANGLE_DEG = 30.0


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A perspective camera. All are (3,); ``up`` is a unit vector."""

    position: FloatArray
    focal_point: FloatArray
    up: FloatArray


def best_direction(
    subject: FloatArray, others: FloatArray, up: FloatArray, along: FloatArray | None = None
) -> FloatArray:
    """The unit direction, from the scene to the camera, that shows ``subject`` (n, 3) best.

    The score falls with the share of ``others`` (m, 3) in front of the subject. It rises the less
    ``along`` (3,) is foreshortened; without ``along``, with the area that all points cover in the
    picture, because parts that are spread out hide each other less.
    """
    center = subject.mean(axis=0)
    offset = others - center
    radius = float(np.linalg.norm(subject - center, axis=1).max())
    everything = np.concatenate([subject, others])
    size = float(np.linalg.norm(np.ptp(everything, axis=0))) ** 2

    def score(towards: FloatArray) -> float:
        right, over = _axes(towards, up)
        occluded = _occluded_share(offset, radius, right, over, towards)
        clarity = (
            float(np.hypot(along @ right, along @ over) / np.linalg.norm(along))
            if along is not None
            else float(np.ptp(everything @ right) * np.ptp(everything @ over)) / size
        )
        return clarity - _OCCLUSION_WEIGHT * occluded

    return max(_directions(up), key=score)


def fit(
    points: FloatArray, towards: FloatArray, up: FloatArray, *, angle_deg: float, aspect: float
) -> Camera:
    """The nearest camera in direction ``towards`` that shows all ``points`` (n, 3).

    ``angle_deg`` is the vertical angle of view, ``aspect`` width over height of the picture.
    """
    right, over = _axes(towards, up)
    tan_y = np.tan(np.radians(0.5 * angle_deg)) / _SPACE_FACTOR
    tan_x = tan_y * aspect
    x, y, z = points @ right, points @ over, points @ towards
    # A point is in the picture if |x - cx| <= (distance - z) tan. The maximum of x + z tan and the
    # minimum of x - z tan bound the picture; their middle is the centre.
    center_x, reach_x = _extent(x, z, tan_x)
    center_y, reach_y = _extent(y, z, tan_y)
    distance = max(reach_x, reach_y)
    focal_z = float(np.median(z))
    focal_point = center_x * right + center_y * over + focal_z * towards
    return Camera(focal_point + (distance - focal_z) * towards, focal_point, over)


def sees(camera: Camera, points: FloatArray, *, angle_deg: float, aspect: float) -> bool:
    """True if all ``points`` (n, 3) are in the picture of ``camera``; the rest as for `fit`."""
    towards = camera.position - camera.focal_point
    towards = towards / np.linalg.norm(towards)
    offset = points - camera.position
    tan = np.tan(np.radians(0.5 * angle_deg)) * -(offset @ towards)
    x, y = np.abs(offset @ np.cross(camera.up, towards)), np.abs(offset @ camera.up)
    return bool(((x <= tan * aspect) & (y <= tan)).all())


def _extent(across: FloatArray, towards: FloatArray, tan: float) -> tuple[float, float]:
    low = float((across - towards * tan).min())
    high = float((across + towards * tan).max())
    return 0.5 * (low + high), 0.5 * (high - low) / tan


def _directions(up: FloatArray) -> Iterator[FloatArray]:
    forward = _any_perpendicular(up)
    side = np.cross(up, forward)
    for elevation in np.radians(_ELEVATIONS_DEG):
        for azimuth in np.linspace(0.0, 2.0 * np.pi, _AZIMUTHS, endpoint=False):
            level = np.cos(azimuth) * forward + np.sin(azimuth) * side
            yield np.cos(elevation) * level + np.sin(elevation) * up


def _occluded_share(
    offset: FloatArray, radius: float, right: FloatArray, over: FloatArray, towards: FloatArray
) -> float:
    """Share of the points ``offset`` (m, 3) from a ball's centre that are in front of the ball."""
    if not len(offset):
        return 0.0
    near = np.hypot(offset @ right, offset @ over) < radius
    return float((near & (offset @ towards > 0.0)).mean())


def _axes(towards: FloatArray, up: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors to the right and up in the picture."""
    right = np.cross(up, towards)
    length = float(np.linalg.norm(right))
    right = _any_perpendicular(towards) if length < 1e-9 else right / length
    return right, np.cross(towards, right)


def _any_perpendicular(vector: FloatArray) -> FloatArray:
    axis = np.zeros(3)
    axis[int(np.argmin(np.abs(vector)))] = 1.0
    perpendicular = np.cross(vector, axis)
    return perpendicular / np.linalg.norm(perpendicular)


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
) -> Camera:
    """A camera at the side ``preset`` that shows all of ``points`` (n, 3), superior up.

    From above and below, anterior is up. ``ras_from_patient`` (3, 3) turns the sides where the
    patient's axes are not those of RAS. ``angle_deg`` as for `fit`.
    """
    turn = np.eye(3) if ras_from_patient is None else ras_from_patient
    towards = np.array(preset.value)
    above = Preset.ANTERIOR if preset in (Preset.SUPERIOR, Preset.INFERIOR) else Preset.SUPERIOR
    up = np.array(above.value)
    return fit(points, turn @ towards, turn @ up, angle_deg=angle_deg, aspect=1.0)


def bullseye(
    ras_from_tip: Transform,
    forward: FloatArray,
    *,
    distance_mm: float,
    previous_up: FloatArray | None = None,
) -> Camera:
    """A camera ``distance_mm`` behind the tool's tip that looks along the tool at the tip.

    ``forward`` (3,) is the direction of the shaft towards the tip, in the tip's frame
    (`forward_of`). The up direction is fixed to the tool, so that the picture turns with it; with
    ``previous_up`` (3,) it stays as near to that as possible. Raises `SceneError` for a zero or
    infinite ``forward`` and a distance that is not above 0.
    """
    length = float(np.linalg.norm(forward))
    if not (length > 0.0 and np.isfinite(length)) or not distance_mm > 0.0:
        raise SceneError(
            f"view along the tool: forward is {np.asarray(forward).tolist()}, distance_mm is "
            f"{distance_mm:g}; expected a finite direction and a distance above 0"
        )
    along = np.asarray(forward, dtype=np.float64) / length
    tip = ras_from_tip.translation_mm
    direction = ras_from_tip.rotate(along)
    hint = ras_from_tip.rotate(_across(along)) if previous_up is None else previous_up
    up = hint - (hint @ direction) * direction
    size = float(np.linalg.norm(up))
    if size < 1e-6:  # the previous up direction is along the tool
        up = ras_from_tip.rotate(_across(along))
        size = float(np.linalg.norm(up))
    return Camera(tip - distance_mm * direction, tip.copy(), up / size)


def forward_of(tool: SurfaceMesh) -> FloatArray:
    """Unit direction (3,) from the middle of ``tool`` to its tip, the origin of its frame.

    Raises `SceneError` for a mesh whose middle is at the tip.
    """
    middle = 0.5 * np.sum(tool.bounds_mm, axis=0)
    length = float(np.linalg.norm(middle))
    if length < 1e-6:
        raise SceneError(
            "tool mesh: its middle is at its tip; expected a mesh on one side of the tip"
        )
    return np.asarray(-middle / length)


def look_through(node: vtkMRMLCameraNode, camera: Camera, angle_deg: float) -> None:
    """Apply ``camera`` to the camera node of a view; its observers are notified once."""
    modifying = node.StartModify()
    node.SetPosition(camera.position.tolist())
    node.SetFocalPoint(camera.focal_point.tolist())
    node.SetViewUp(camera.up.tolist())
    node.SetViewAngle(angle_deg)
    node.ResetClippingRange()
    node.EndModify(modifying)


def center_on(node: vtkMRMLCameraNode, point: FloatArray) -> None:
    """Move the camera of ``node`` without a turn until ``point`` (3,) is in the middle."""
    shift = point - np.array(node.GetFocalPoint())
    if not shift.any():
        return
    modifying = node.StartModify()
    node.SetPosition((np.array(node.GetPosition()) + shift).tolist())
    node.SetFocalPoint(point.tolist())
    node.ResetClippingRange()
    node.EndModify(modifying)


def _across(along: FloatArray) -> FloatArray:
    """Unit vector (3,) perpendicular to ``along``, nearest to a coordinate axis."""
    axis = np.zeros(3)
    axis[int(np.argmin(np.abs(along)))] = 1.0
    across = axis - (axis @ along) * along
    return np.asarray(across / np.linalg.norm(across))
