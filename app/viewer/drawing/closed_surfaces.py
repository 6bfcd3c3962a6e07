"""Model nodes of a scene with closed surfaces: their inner sides are hidden when opaque."""

from slicer import vtkMRMLModelNode

from app.geometry import SurfaceMesh
from app.runtime import SessionContent
from app.scene import MarginGuardScene


def closed_models(
    scene: MarginGuardScene, content: SessionContent, margin_surface: SurfaceMesh | None
) -> set[vtkMRMLModelNode]:
    """The models of which every part is closed with normals outward.

    The tip's ball, which has no mesh in ``content``, is left out.
    """
    surfaces = [(scene.tumor, [content.tumor])]
    if margin_surface is not None:
        surfaces.append((scene.margin_surface, [margin_surface]))
    if content.tool is not None:
        surfaces.append((scene.tool, [content.tool]))
    if content.needle is not None and content.needle.is_generated:
        surfaces.append((scene.needle, [content.needle.surface]))
    if content.robot is not None:
        links = {link.name: link for link in content.robot.robot.links}
        for robot in scene.robots.values():
            for name, model in robot.models.items():
                surfaces.append((model, [shape.mesh for shape in links[name].visuals]))
    return {
        model for model, meshes in surfaces if model is not None and all(map(_is_closed, meshes))
    }


def _is_closed(mesh: SurfaceMesh) -> bool:
    return mesh.open_edges() == 0 and mesh.signed_volume_mm3 > 0.0
