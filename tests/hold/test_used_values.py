"""Differences between the values of the last run and those of this one, as texts."""

import json
from dataclasses import replace

import numpy as np
import pytest

from app.geometry import SurfaceMesh, Transform
from app.hold.changes import causes_of_change
from app.registration import given_registration
from app.runtime import StructureContent, used_values
from app.runtime.display_items import ImageDepth
from app.session import Role
from tests.session_content import FACES, TETRAHEDRON, one_link_content, registered

CONTENT = one_link_content()


def edges(**moved_mm):
    """The static edges of the content, those of some frames moved along x."""
    return tuple(
        replace(
            edge,
            translation_mm=np.add(edge.translation_mm, (moved_mm.get(edge.source, 0.0), 0.0, 0.0)),
        )
        for edge in CONTENT.static_edges
    )


def base(*position_mm):
    return given_registration(Transform("reference", "robot_base", np.eye(3), position_mm))


LARGER = SurfaceMesh("tumor", 1.01 * TETRAHEDRON, FACES)


def with_wall(*, stop_mm=2.0, z_mm=-40.0):
    surface = SurfaceMesh("wall", CONTENT.tumor.vertices_mm, CONTENT.tumor.faces)
    pose = Transform("reference", "wall", np.eye(3), [0.0, 0.0, z_mm])
    return replace(
        CONTENT,
        structures=(StructureContent(surface, Role.FORBIDDEN, stop_mm, 6.0),),
        static_edges=(*CONTENT.static_edges, pose),
    )


CHANGES = {
    "surface": (
        replace(CONTENT, tumor=LARGER),
        f"the tumour is {replace(CONTENT, tumor=LARGER).model_id} instead of {CONTENT.model_id}",
    ),
    "pose of the tumour": (
        replace(CONTENT, static_edges=edges(tumor=2.0)),
        "the tumour is moved by 2.00 mm and turned by 0.00 degrees",
    ),
    "sigma of the tumour": (
        replace(CONTENT, tumor_sigma_mm=0.5),
        "uncertainty of the tumour 0.50 instead of 0.00 mm",
    ),
    "tip": (
        replace(CONTENT, static_edges=edges(cautery_tip=0.2)),
        "the tip is moved by 0.20 mm and turned by 0.00 degrees",
    ),
    "sigma of the tip": (
        replace(CONTENT, tip_sigma_mm=0.25),
        "uncertainty of the tip 0.25 instead of 0.00 mm",
    ),
    "registration": (
        registered(CONTENT, base(500.0, 3.0, -250.0)),
        "the robot's base is moved by 3.00 mm and turned by 0.00 degrees",
    ),
    "no registration": (
        replace(CONTENT, robot=replace(CONTENT.robot, registration=None)),
        "registration removed",
    ),
    "margins": (
        replace(CONTENT, margins=CONTENT.margins.replaced(stop_mm=0.5)),
        f"stop_mm lowered from {CONTENT.margins.stop_mm:g} to 0.5",
    ),
    "structure": (with_wall(), "structure 'wall' added"),
    "depth": (
        replace(CONTENT, image_depth=ImageDepth((30.0, 60.0), 60.0)),
        "the depth of the images is 60 mm instead of not stated",
    ),
}


@pytest.mark.parametrize("name", CHANGES)
def test_each_change_is_named_with_its_size(name):
    content, text = CHANGES[name]
    stored = json.loads(json.dumps(used_values(CONTENT)))
    assert causes_of_change(stored, used_values(content)) == (f"not as in the last run: {text}",)


def test_equal_values_are_no_change():
    stored = json.loads(json.dumps(used_values(CONTENT)))
    assert causes_of_change(stored, used_values(one_link_content())) == ()


def test_a_tool_in_other_frames_is_named():
    other = Transform("probe", "cautery_tip", np.eye(3), [0.0, 0.0, 120.0])
    content = replace(CONTENT, static_edges=(other, *CONTENT.static_edges[1:]))
    assert causes_of_change(used_values(CONTENT), used_values(content)) == (
        "not as in the last run: the tip is 'cautery_tip' in 'probe' instead of 'cautery_tip' in "
        "'cautery'",
    )


@pytest.mark.parametrize(
    ("now", "text"),
    [
        (CONTENT, "structure 'wall' removed"),
        (with_wall(stop_mm=1.5), "structure 'wall': stop_mm 1.5 instead of 2"),
        (with_wall(z_mm=-43.0), "structure 'wall' is moved by 3.00 mm and turned by 0.00 degrees"),
    ],
)
def test_a_changed_structure_is_named(now, text):
    stored = json.loads(json.dumps(used_values(with_wall())))
    assert causes_of_change(stored, used_values(now)) == (f"not as in the last run: {text}",)


def test_a_record_without_structures_is_compared():
    stored = json.loads(json.dumps(used_values(CONTENT)))
    del stored["structures"]
    assert causes_of_change(stored, used_values(CONTENT)) == ()
