import numpy as np
import trimesh

from app.fixture import ProximityEngine
from app.geometry import SurfaceMesh, Transform
from app.session import ToolEngines


def surface(frame, mesh):
    return SurfaceMesh(frame, mesh.vertices, mesh.faces)


def test_engines_for_one_tool_are_as_new_ones_and_prepare_it_once():
    box = surface("tool", trimesh.creation.box([4, 4, 30]))
    rod = surface("tool", trimesh.creation.cylinder(2.0, 30.0))
    balls = [surface("tumor", trimesh.creation.icosphere(3, radius)) for radius in (9.0, 12.0)]
    engines, tools = ToolEngines(), []
    for tumor, tool in ((balls[0], box), (balls[1], box), (balls[0], rod), (balls[1], box)):
        made, new = engines(tumor, tool), ProximityEngine(tumor, tool)
        tools.append(made._tool.fixed)
        for z_mm in (40.0, 26.0, 25.5, 60.0, 20.0):
            pose = Transform("tumor", "tool", np.eye(3), np.array([1.0, 2.0, z_mm]))
            found, expected = made.evaluate(pose), new.evaluate(pose)
            assert found.lower_bound_mm == expected.lower_bound_mm
            assert found.signed_distance_mm == expected.signed_distance_mm
            assert found.contact == expected.contact
    assert tools[1] is tools[0] and tools[2] is not tools[1] and tools[3] is not tools[2]
