"""Brute-force transform tree, independent of `app.bridge.tf`."""

import numpy as np
from scipy.spatial.transform import Rotation, Slerp


def matrix(pose):
    """Homogeneous matrix of ``(x, y, z, qx, qy, qz, qw)``."""
    result = np.eye(4)
    result[:3, :3] = Rotation.from_quat(pose[3:]).as_matrix()
    result[:3, 3] = pose[:3]
    return result


class BruteForceTree:
    """Keeps every sample in a dictionary and multiplies matrices up to the common ancestor.

    Interpolates with `scipy.spatial.transform.Slerp` and `numpy.interp`.
    """

    def __init__(self):
        self.parent, self.samples = {}, {}

    def insert(self, parent, child, stamp, pose):
        """Add ``parent_from_child``; the first sample of a stamp is kept."""
        self.parent[child] = parent
        self.samples.setdefault(child, {}).setdefault(stamp, pose)

    def edge(self, child, stamp):
        """Matrix ``parent_from_child`` (4, 4); raises `KeyError` outside the samples."""
        samples = self.samples[child]
        if stamp in samples:
            return matrix(samples[stamp])
        times = np.array(sorted(samples))
        if not times[0] <= stamp <= times[-1]:
            raise KeyError(stamp)
        rotations = Rotation.from_quat([samples[time][3:] for time in times])
        result = np.eye(4)
        # Times relative to the first sample, because SciPy converts times to floats.
        result[:3, :3] = Slerp(times - times[0], rotations)(stamp - times[0]).as_matrix()
        positions = np.array([samples[time][:3] for time in times])
        for axis in range(3):
            result[axis, 3] = np.interp(stamp - times[0], times - times[0], positions[:, axis])
        return result

    def chain(self, frame):
        """``frame`` and its ancestors."""
        names = [frame]
        while names[-1] in self.parent:
            names.append(self.parent[names[-1]])
        return names

    def lookup(self, target, source, stamp):
        """Matrix ``target_from_source``; raises `LookupError` if there is no path."""
        first, second = self.chain(target), self.chain(source)
        top = next((name for name in first if name in second), None)
        if top is None:
            raise LookupError
        product = np.eye(4)
        for child in first[: first.index(top)]:
            product = product @ np.linalg.inv(self.edge(child, stamp))
        for child in reversed(second[: second.index(top)]):
            product = product @ self.edge(child, stamp)
        return product
