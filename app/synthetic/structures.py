"""Further structures of a simulated case: a second lesion and the chest wall, with their truth."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from app.case.manifest.structures import as_schema_2
from app.case.new_case import placed_mesh
from app.geometry import FloatArray, SurfaceMesh, Transform
from app.synthetic.simulation import SENSOR_FROM_TUMOR, Simulation
from app.synthetic.truth import Clearance, Motion, TrueBreach, find_breaches
from app.synthetic.tumour_and_tool import TUMOR_FRAME, TUMOR_SENSOR, Tumour, tool_mesh, write_stl

LESION_RADIUS_MM = 5.0
LESION_GAP_MM = 6.0
"""From the tumour's surface to the second lesion, which lies beside it."""

WALL_SEMI_AXES_MM = (45.0, 45.0, 12.0)
WALL_GAP_MM = 3.0
"""From the tumour's lowest point to the chest wall below it, at end expiration."""


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedStructure:
    """A structure with its true shape around the origin of its own frame.

    ``entry`` are its values in ``case.yaml`` but for mesh and pose; ``frame_from_structure`` is
    exact; ``tracked``: the true pose of its tracked frame in the tracker at a time in s.
    """

    entry: dict[str, Any]
    shape: Tumour
    frame_from_structure: Transform
    tracked: Callable[[float], Transform]

    @property
    def name(self) -> str:
        """Its name, and that of its frame."""
        return str(self.entry["name"])

    def mesh(self) -> SurfaceMesh:
        """Its surface."""
        mesh = self.shape.mesh(4)
        return SurfaceMesh(self.name, mesh.vertices_mm, mesh.faces)

    def structure_from_tip(self, simulation: Simulation) -> Motion:
        """The true motion of the tool in its frame."""

        def at(time_s: float) -> Transform:
            tracker_from_structure = self.tracked(time_s) @ self.frame_from_structure
            base_from_tip = simulation.base_from_tip(time_s)
            return tracker_from_structure.inverse() @ simulation.tracker_from_base @ base_from_tip

        return at

    def breaches(self, simulation: Simulation) -> tuple[TrueBreach, ...]:
        """Every interval in which the tool is in it."""
        clearance = Clearance(self.shape, tool_mesh())
        return find_breaches(clearance, self.structure_from_tip(simulation), simulation.duration_s)


def further_structures(simulation: Simulation) -> tuple[SimulatedStructure, ...]:
    """The second lesion, which moves with the tumour, and the chest wall, with the reference."""
    tumour = simulation.tumour
    sideways = np.array([0.0, 1.0, 0.0])
    away_mm = float(tumour.radius_mm(sideways[None])[0]) + LESION_GAP_MM + LESION_RADIUS_MM
    lesion_from_tumor = Transform("lesion_2", TUMOR_FRAME, np.eye(3), -away_mm * sideways)
    sensor_from_lesion = SENSOR_FROM_TUMOR @ lesion_from_tumor.inverse()
    reference_from_tumor = (
        simulation.tracker_from("reference", 0.0).inverse()
        @ simulation.tracker_from(TUMOR_SENSOR, 0.0)
        @ SENSOR_FROM_TUMOR
    )
    # Below: along -z of the robot's base, whose z axis is up.
    reference_from_base = simulation.tracker_from("reference", 0.0).inverse() @ (
        simulation.tracker_from_base
    )
    up = reference_from_base.rotate(np.array([0.0, 0.0, 1.0]))
    depth_mm = tumour.max_radius_mm + WALL_GAP_MM + WALL_SEMI_AXES_MM[2]
    reference_from_wall = Transform(
        "reference",
        "chest_wall",
        reference_from_base.rotation,
        reference_from_tumor.translation_mm - depth_mm * up,
    )
    return (
        SimulatedStructure(
            {
                "name": "lesion_2",
                "role": "target",
                "frame": TUMOR_SENSOR,
                "margins": {"stop_mm": 1.0, "warn_mm": 4.0},
            },
            _ellipsoid((LESION_RADIUS_MM,) * 3),
            sensor_from_lesion,
            lambda time_s: simulation.tracker_from(TUMOR_SENSOR, time_s),
        ),
        SimulatedStructure(
            {
                "name": "chest_wall",
                "role": "forbidden",
                "frame": "reference",
                "margins": {"stop_mm": 2.0, "warn_mm": 6.0},
            },
            _ellipsoid(WALL_SEMI_AXES_MM),
            reference_from_wall,
            lambda time_s: simulation.tracker_from("reference", time_s),
        ),
    )


def with_structures(
    manifest: dict[str, Any], structures: tuple[SimulatedStructure, ...], folder: Path
) -> dict[str, Any]:
    """``manifest`` in schema 2 with ``structures``, whose meshes are written to ``folder``."""
    found = as_schema_2(manifest)
    for each in structures:
        file = f"{each.name}.stl"
        write_stl(folder / file, each.mesh())
        found["structures"].append({**each.entry, **placed_mesh(file, each.frame_from_structure)})
    return found


def _ellipsoid(semi_axes_mm: tuple[float, float, float]) -> Tumour:
    none: FloatArray = np.zeros((0, 3))
    return Tumour(np.array(semi_axes_mm), none, np.zeros(0), np.zeros(0))
