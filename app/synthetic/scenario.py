"""The scenario of the simulated lumpectomy: the planned motion of the tool over time.

Poses are planned in ``work``, a frame at the tumour's centre with the axes of the robot's base:
x away from the robot, z up. The surgeon follows the tissue, so the planned poses are relative to
the tumour while it moves with the breath.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from app.geometry import FloatArray, Transform
from app.synthetic.case_options import USUAL_SURGEON, SurgeonOptions
from app.synthetic.error_budget import CROSSING_SPEED_MM_S, Depths
from app.synthetic.motion import Path
from app.synthetic.script import Script
from app.synthetic.tracker_model import Dropout, DropoutKind
from app.synthetic.truth import Clearance
from app.synthetic.tumour_and_tool import TIP_FRAME, TOOL_SENSOR, TUMOR_SENSOR, Tumour

WORK_FRAME = "work"

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
PASSES_S = 41.0
"""Strokes around the tumour, without approaches and breaches."""
_REST_OF_CASE_S = 34.0
WORK_STROKE_S = 12.0
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
    crossing_speed_mm_s: float
    """The smallest speed along the normal at which the tool crosses the surface."""


def plan_scenario(
    tumour: Tumour,
    clearance: Clearance,
    tumor_from_work: Transform,
    depths: Depths,
    duration_s: float | None,
    random: np.random.Generator,
    surgeon: SurgeonOptions = USUAL_SURGEON,
) -> Scenario:
    """Plan landmarks in a breath-hold, then passes around the tumour with three breaches.

    Without ``duration_s`` the passes take `PASSES_S`. A shorter case has faster passes, a longer
    one ``random`` work around the tumour between them; a rest fills up the duration. ``surgeon``
    changes the pace without a duration, the strokes, and which breaches happen.
    """
    plan = _Plan(tumour, tumor_from_work, surgeon, random)
    speeds_mm_s = [CROSSING_SPEED_MM_S]
    pace, extra_s = surgeon.pace, 0.0
    if duration_s is not None:
        pace = min(1.0, (duration_s - _REST_OF_CASE_S) / PASSES_S)
        extra_s = max(0.0, duration_s - _REST_OF_CASE_S - PASSES_S)
    landmarks = [plan.landmark(index) for index in range(len(LANDMARKS_MM))]
    script = Script(landmarks[0], clearance.distance_mm)
    dwells = []
    for index, landmark in enumerate(landmarks):
        if index:
            script.move_to(landmark, 1.0)
        start_s, end_s = script.rest(DWELL_S)
        dwells.append((start_s + DWELL_EDGE_S, end_s - DWELL_EDGE_S))
    held_until_s = script.end_s + 0.5

    def work(azimuth_deg: float) -> None:
        """Strokes around the tumour and back, near its surface, for a third of the extra time."""
        count = int(np.ceil(extra_s / 3.0 / WORK_STROKE_S))
        for _ in range(count):
            span = random.choice([-1.0, 1.0]) * random.uniform(60.0, 180.0)
            colatitude = random.uniform(38.0, 64.0)
            distance = depths.nearest_mm + random.uniform(0.5, 5.0)
            there = plan.ring(azimuth_deg, azimuth_deg + span, colatitude, distance)
            script.stroke([*there, *there[::-1][1:]], extra_s / 3.0 / count)

    def halt(touching: Transform, inward: FloatArray, hold_s: float) -> None:
        script.halt(
            touching,
            inward,
            distance_mm=depths.halt_mm,
            hold_s=hold_s,
            speed_mm_s=CROSSING_SPEED_MM_S,
        )

    def enter(azimuth_deg: float, colatitude_deg: float, depth_mm: float, hold_s: float) -> None:
        """A plunge along the normal, or to the centre where that is not deep enough anywhere."""
        touching = plan.beside(azimuth_deg, colatitude_deg, 1.0)
        inward = -plan.normal(azimuth_deg, colatitude_deg)
        happens = surgeon.enters(random)
        deeper_mm = min(depth_mm * surgeon.depth_factor(random), depths.deepest_mm)
        depth_mm = max(depth_mm, deeper_mm)
        if not happens:
            return
        if surgeon.fixture:
            halt(touching, inward, hold_s)
            return
        if not script.reaches(touching, inward, depth_mm):
            inward = plan.to_centre(azimuth_deg, colatitude_deg)
            share = float(-inward @ plan.normal(azimuth_deg, colatitude_deg))
            speeds_mm_s.append(share * CROSSING_SPEED_MM_S)
        script.plunge(
            touching, inward, depth_mm=depth_mm, hold_s=hold_s, speed_mm_s=CROSSING_SPEED_MM_S
        )

    script.move_to(plan.beside(-100.0, 30.0, 30.0), 2.5)
    first_pass_s = script.end_s
    script.stroke(plan.ring(-90.0, 250.0, 32.0, 8.0), 11.0 * pace)
    work(250.0)

    second_pass_s = script.end_s
    script.stroke(plan.ring(240.0, -80.0, 50.0, max(5.0, depths.nearest_mm)), 13.0 * pace)
    work(-80.0)
    enter(-85.0, 42.0, depths.deep_mm, 0.6)

    third_pass_s = script.end_s
    script.stroke(plan.ring(-70.0, 150.0, 66.0, depths.nearest_mm), 12.0 * pace)
    work(150.0)
    enter(165.0, 60.0, depths.brief_mm, 0.12)

    fourth_pass_s = script.end_s
    script.stroke(plan.ring(160.0, 80.0, 66.0, max(6.0, depths.nearest_mm)), 5.0 * pace)
    script.move_to(plan.along_the_side(90.0, 30.0), 2.0)
    aside = plan.along_the_side(90.0, min(14.0, 1.2 * tumour.max_radius_mm))
    shaft_enters = surgeon.enters(random)
    if shaft_enters and surgeon.fixture:
        halt(aside, -plan.outward(90.0), 0.5)
    elif shaft_enters:
        script.plunge(
            aside,
            -plan.outward(90.0),
            depth_mm=depths.shaft_mm,
            hold_s=0.5,
            speed_mm_s=CROSSING_SPEED_MM_S,
        )
    script.move_to(plan.beside(90.0, 30.0, 45.0), 3.0)
    script.rest(1.0 if duration_s is None else max(duration_s - script.end_s, 0.2))

    def lost(frames: tuple[str, ...], kind: DropoutKind, start_s: float, for_s: float) -> Dropout:
        return Dropout(frames, kind, start_s, start_s + for_s)

    all_frames = ("reference", TUMOR_SENSOR, TOOL_SENSOR)
    dropouts = (
        lost((TOOL_SENSOR,), "invalid", first_pass_s + 2.0 * pace, 0.8),
        lost(all_frames, "missing", first_pass_s + 6.0 * pace, 0.6),
        lost((TUMOR_SENSOR,), "missing", second_pass_s + 5.0 * pace, 0.7),
        lost((TOOL_SENSOR,), "missing", third_pass_s + 5.0 * pace, 1.0),
        lost(("reference",), "invalid", fourth_pass_s + 2.5 * pace, 0.5),
    )
    return Scenario(script.path, tuple(dwells), held_until_s, dropouts, min(speeds_mm_s))


class _Plan:
    """Poses ``tumor_from_tip`` by their position around the tumour, in degrees and mm.

    ``azimuth``: about work's z, 0 away from the robot. ``colatitude``: from straight above.
    """

    def __init__(
        self,
        tumour: Tumour,
        tumor_from_work: Transform,
        surgeon: SurgeonOptions,
        random: np.random.Generator,
    ) -> None:
        self._tumour = tumour
        self._tumor_from_work = tumor_from_work
        self._surgeon, self._random = surgeon, random

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
        poses = []
        for azimuth in azimuths.tolist():
            off_deg, off_mm = self._surgeon.wander(self._random)
            poses.append(self.beside(azimuth, colatitude_deg + off_deg, distance_mm + off_mm))
        return poses

    def along_the_side(self, azimuth_deg: float, aside_mm: float) -> Transform:
        """The shaft upright, ``aside_mm`` from the tumour's centre, the tip 19 mm below it."""
        position = aside_mm * self._outward(azimuth_deg) + np.array([0.0, 0.0, -19.0])
        return self._pose(position, self._outward(azimuth_deg), 0.0)

    def normal(self, azimuth_deg: float, colatitude_deg: float) -> FloatArray:
        """The outward normal (3,) of the tumour, in the tumour's frame."""
        return self._tumor_from_work.rotate(self._surface(azimuth_deg, colatitude_deg)[1])

    def to_centre(self, azimuth_deg: float, colatitude_deg: float) -> FloatArray:
        """The direction (3,) from the surface to the tumour's centre, in the tumour's frame."""
        surface, _ = self._surface(azimuth_deg, colatitude_deg)
        return self._tumor_from_work.rotate(-surface / np.linalg.norm(surface))

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
        work_from_tip = Transform(WORK_FRAME, TIP_FRAME, rotation, tip_mm)
        return self._tumor_from_work @ work_from_tip
