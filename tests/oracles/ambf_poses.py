"""Poses of AMBF bodies from the values of the YAML file, by scipy's Euler angles."""

import numpy as np
from scipy.spatial.transform import Rotation


def world_from_body(location):
    """``world_from_body`` (4, 4) in mm from a ``location`` in m and rad."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler(
        "xyz", [location["orientation"][axis] for axis in "rpy"]
    ).as_matrix()
    matrix[:3, 3] = [1000.0 * location["position"][axis] for axis in "xyz"]
    return matrix
