"""The description of a session: static transforms that form a tree, identifiers that change."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from app.geometry import FrameError, SurfaceMesh, Transform
from app.registration import given_registration
from app.runtime import SessionContent
from tests.session_content import one_link_content, registered


@pytest.fixture
def content() -> SessionContent:
    return one_link_content()


def test_frame_with_two_parents_is_refused(content):
    second = Transform.identity("tracker", "tumor")
    with pytest.raises(FrameError, match=r"'tumor' has 2 parents"):
        replace(content, static_edges=(*content.static_edges, second))


def test_model_id_changes_with_one_vertex(content):
    moved = content.tumor.vertices_mm.copy()
    moved[3, 2] += 1e-9
    other = replace(content, tumor=SurfaceMesh("tumor", moved, content.tumor.faces))
    assert other.model_id != content.model_id
    assert replace(content).model_id == content.model_id


def test_registration_id_changes_with_the_registration(content):
    moved = Transform("reference", "robot_base", np.eye(3), [500.0, 0.0, -250.001])
    other = registered(content, given_registration(moved))
    assert other.registration_id != content.registration_id
    assert replace(content, robot=None).registration_id == ""


def test_base_and_root_link_with_two_names_are_joined_and_with_one_name_left_alone(content):
    joined = [edge for edge in content.tf_static_edges if edge not in content.static_edges]
    (edge,) = joined
    assert (edge.target, edge.source) == ("robot_base", "base_link")
    assert np.array_equal(edge.matrix, np.eye(4))
    same_name = replace(content.robot, base_frame="base_link", registration=None)
    alone = replace(content, robot=same_name)
    assert alone.tf_static_edges == alone.static_edges


def test_content_of_the_recorded_case_survives_pickling(recorded_case):
    content = recorded_case.content
    again = pickle.loads(pickle.dumps(content))
    assert again.model_id == content.model_id
    assert again.registration_id == content.registration_id
    assert [edge.matrix.tolist() for edge in again.tf_static_edges] == [
        edge.matrix.tolist() for edge in content.tf_static_edges
    ]
