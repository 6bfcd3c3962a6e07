"""The fixed part of a replay: a tree that cannot be torn, and names that change with content."""

from dataclasses import replace

import numpy as np
import pytest

from app.bridge.errors import BridgeError
from app.bridge.publishing.replay_scene import root_edges
from app.geometry import SurfaceMesh, Transform
from app.registration import given_registration


def test_a_frame_with_two_parents_is_refused(scene):
    second = Transform.identity("tracker", "tumor")
    with pytest.raises(BridgeError, match=r"'tumor' has 2 parents"):
        replace(scene, static_edges=(*scene.static_edges, second))


def test_the_model_id_changes_with_one_vertex(scene):
    moved = scene.tumor.vertices_mm.copy()
    moved[3, 2] += 1e-9
    other = replace(scene, tumor=SurfaceMesh("tumor", moved, scene.tumor.faces))
    assert other.model_id != scene.model_id
    assert replace(scene).model_id == scene.model_id


def test_the_registration_id_changes_with_the_registration(scene):
    moved = Transform("reference", "robot_base", np.eye(3), [500.0, 0.0, -250.001])
    other = replace(scene, registration=given_registration(moved))
    assert other.registration_id != scene.registration_id
    assert replace(scene, registration=None).registration_id == ""


def test_one_place_with_two_names_is_joined_and_with_one_name_left_alone():
    (edge,) = root_edges("robot_base", "base_link")
    assert (edge.target, edge.source) == ("robot_base", "base_link")
    assert np.array_equal(edge.matrix, np.eye(4))
    assert root_edges("base", "base") == ()
