"""The scenario of the simulated lumpectomy: the planned motion of the tool over time.

Poses are planned in ``work``, a frame at the tumour's centre with the axes of the robot's base:
x away from the robot, z up. The surgeon follows the tissue, so the planned poses are relative to
the tumour while it moves with the breath.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from app.geometry import FloatArray, Transform
from app.synthetic.cautery import CAUTERY_TIP_FRAME
from app.synthetic.clearance import Clearance
from app.synthetic.motion import Path
from app.synthetic.script import Script
from app.synthetic.tracker import Dropout
from app.synthetic.tumour import Tumour

WORK_FRAME = "work"

CROSSING_SPEED_MM_S = 45.0
"""Fast enough that jitter moves a detected crossing by a frame or two at most; below v_max."""

LANDMARKS_MM = (
    (-40.0, -44.0, -12.0),
    (38.0, -50.0, -20.0),
    (42.0, 44.0, -14.0),
    (-44.0, 48.0, -22.0),
    (-38.0, 50.0, 36.0),
    (40.0, 46.0, 42.0),
    (38.0, -46.0, 34.0),
    (-44.0, -48.0, 44.0),
)
"""Corners of a box around the tumour, in an order in which every move follows an edge of the box.
Their heights differ, so that no four of them are coplanar."""
DWELL_S = 1.3
DWELL_EDGE_S = 0.05
"""Removed from both ends of a rest, so that a dwell in the manifest holds samples at rest only."""

_DOWN = np.array([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
"""The tool points down, its x-axis to the robot: the middle of the wrist's range."""


@dataclass(frozen=True, slots=True, eq=False)
class Scenario:
    """The planned motion ``tumor_from_tip`` and its events; times in s from the first frame."""

    path: Path
    dwells_s: tuple[tuple[float, float], ...]
    breath_held_until_s: float
    dropouts: tuple[Dropout, ...]


def plan_scenario(tumour: Tumour, clearance: Clearance, tumor_from_work: Transform) -> Scenario:
    """Plan landmarks in a breath-hold, then passes around the tumour with three breaches."""
    plan = _Plan(tumour, tumor_from_work)
    landmarks = [plan.landmark(index) for index in range(len(LANDMARKS_MM))]
    script = Script(landmarks[0], clearance.distance_mm)
    dwells = []
    for index, landmark in enumerate(landmarks):
        if index:
            script.move_to(landmark, 1.0)
        start_s, end_s = script.rest(DWELL_S)
        dwells.append((start_s + DWELL_EDGE_S, end_s - DWELL_EDGE_S))
    held_until_s = script.end_s + 0.5

    script.move_to(plan.beside(-100.0, 30.0, 30.0), 2.5)
    first_pass_s = script.end_s
    script.stroke(plan.ring(-90.0, 250.0, 32.0, 8.0), 11.0)

    second_pass_s = script.end_s
    script.stroke(plan.ring(240.0, -80.0, 50.0, 5.0), 13.0)
    script.plunge(
        plan.beside(-85.0, 42.0, 1.0),
        -plan.normal(-85.0, 42.0),
        depth_mm=5.0,
        hold_s=0.6,
        speed_mm_s=CROSSING_SPEED_MM_S,
    )

    third_pass_s = script.end_s
    script.stroke(plan.ring(-70.0, 150.0, 66.0, 3.5), 12.0)
    script.plunge(
        plan.beside(165.0, 60.0, 1.0),
        -plan.normal(165.0, 60.0),
        depth_mm=1.8,
        hold_s=0.12,
        speed_mm_s=CROSSING_SPEED_MM_S,
    )

    fourth_pass_s = script.end_s
    script.stroke(plan.ring(160.0, 80.0, 66.0, 6.0), 5.0)
    script.move_to(plan.along_the_side(90.0, 30.0), 2.0)
    script.plunge(
        plan.along_the_side(90.0, 14.0),
        -plan.outward(90.0),
        depth_mm=2.8,
        hold_s=0.5,
        speed_mm_s=CROSSING_SPEED_MM_S,
    )
    script.move_to(plan.beside(90.0, 30.0, 45.0), 3.0)
    script.rest(1.0)

    all_frames = ("reference", "needle", "cautery")
    dropouts = (
        Dropout(("cautery",), "invalid", first_pass_s + 2.0, first_pass_s + 2.8),
        Dropout(all_frames, "missing", first_pass_s + 6.0, first_pass_s + 6.6),
        Dropout(("needle",), "missing", second_pass_s + 5.0, second_pass_s + 5.7),
        Dropout(("cautery",), "missing", third_pass_s + 5.0, third_pass_s + 6.0),
        Dropout(("reference",), "invalid", fourth_pass_s + 2.5, fourth_pass_s + 3.0),
    )
    return Scenario(script.path, tuple(dwells), held_until_s, dropouts)


class _Plan:
    """Poses ``tumor_from_tip`` by their position around the tumour, in degrees and mm.

    ``azimuth``: about work's z, 0 away from the robot. ``colatitude``: from straight above.
    """

    def __init__(self, tumour: Tumour, tumor_from_work: Transform) -> None:
        self._tumour = tumour
        self._tumor_from_work = tumor_from_work

    def landmark(self, index: int) -> Transform:
        """The tip on a landmark, the tool tilted slightly outward."""
        position = np.array(LANDMARKS_MM[index])
        return self._pose(position, position, 0.3)

    def beside(self, azimuth_deg: float, colatitude_deg: float, distance_mm: float) -> Transform:
        """The tip above the surface by ``distance_mm``, the handle tilted away from the tumour."""
        surface, normal = self._surface(azimuth_deg, colatitude_deg)
        tilt = 0.4 * np.deg2rad(colatitude_deg)
        return self._pose(surface + distance_mm * normal, self._outward(azimuth_deg), tilt)

    def ring(
        self, start_deg: float, end_deg: float, colatitude_deg: float, distance_mm: float
    ) -> list[Transform]:
        """Poses around the tumour from one azimuth to another, 15 degrees apart at most."""
        count = int(np.ceil(abs(end_deg - start_deg) / 15.0)) + 1
        azimuths = np.linspace(start_deg, end_deg, count)
        return [self.beside(a, colatitude_deg, distance_mm) for a in azimuths.tolist()]

    def along_the_side(self, azimuth_deg: float, aside_mm: float) -> Transform:
        """The shaft upright, ``aside_mm`` from the tumour's centre, the tip 19 mm below it."""
        position = aside_mm * self._outward(azimuth_deg) + np.array([0.0, 0.0, -19.0])
        return self._pose(position, self._outward(azimuth_deg), 0.0)

    def normal(self, azimuth_deg: float, colatitude_deg: float) -> FloatArray:
        """The outward normal (3,) of the tumour, in the tumour's frame."""
        return self._tumor_from_work.rotate(self._surface(azimuth_deg, colatitude_deg)[1])

    def outward(self, azimuth_deg: float) -> FloatArray:
        """The horizontal direction (3,) away from the tumour's centre, in the tumour's frame."""
        return self._tumor_from_work.rotate(self._outward(azimuth_deg))

    def _outward(self, azimuth_deg: float) -> FloatArray:
        azimuth = np.deg2rad(azimuth_deg)
        return np.array([np.cos(azimuth), np.sin(azimuth), 0.0])

    def _surface(self, azimuth_deg: float, colatitude_deg: float) -> tuple[FloatArray, FloatArray]:
        colatitude = np.deg2rad(colatitude_deg)
        ray = np.sin(colatitude) * self._outward(azimuth_deg)
        ray[2] = np.cos(colatitude)
        in_tumor = self._tumour.surface_mm(self._tumor_from_work.rotate(ray)[None])
        work_from_tumor = self._tumor_from_work.inverse()
        normal = self._tumour.normals(in_tumor)[0]
        return work_from_tumor.apply(in_tumor[0]), work_from_tumor.rotate(normal)

    def _pose(self, tip_mm: FloatArray, handle_towards: FloatArray, tilt_rad: float) -> Transform:
        """The tip at ``tip_mm``, the handle tilted by ``tilt_rad`` from the vertical."""
        horizontal = np.array([handle_towards[0], handle_towards[1], 0.0])
        axis = np.cross((0.0, 0.0, 1.0), horizontal / np.linalg.norm(horizontal))
        rotation = Rotation.from_rotvec(tilt_rad * axis).as_matrix() @ _DOWN
        work_from_tip = Transform(WORK_FRAME, CAUTERY_TIP_FRAME, rotation, tip_mm)
        return self._tumor_from_work @ work_from_tip
