"""Invalid input and the errors that it raises."""

from collections.abc import Callable, Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from app.geometry import Transform
from app.registration import (
    RegistrationError,
    calibrate_pivot,
    calibrate_spin,
    register_points,
    solve_robot_world,
)
from benchmarks.registration.figures import FRAMES, Figure


def bad_input(_: int) -> Iterator[Figure]:
    """Yield a figure for each kind of invalid input."""
    box = np.array([[0, 0, 0], [80, 0, 0], [0, 60, 0], [0, 0, 40], [70, 50, 30.0]])
    line = np.outer(np.arange(5.0), [10.0, 20, 5])
    nan, infinite = box.copy(), box.copy()
    nan[1, 1], infinite[1, 1] = np.nan, np.inf
    turned = Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix()
    pose = Transform("reference", "tool", turned, np.array([1.0, 2.0, 3.0]))
    cases: dict[str, Callable[[], object]] = {
        "two points": lambda: register_points(box[:2], box[:2], **FRAMES),
        "coincident": lambda: register_points(np.ones((4, 3)), box[:4], **FRAMES),
        "collinear": lambda: register_points(line, line, **FRAMES),
        "nearly collinear": lambda: register_points(line + box / 50, line + box / 50, **FRAMES),
        "mirrored": lambda: register_points(box, box * [1, 1, -1], **FRAMES),
        "NaN": lambda: register_points(box, nan, **FRAMES),
        "infinite": lambda: register_points(infinite, box, **FRAMES),
        "unequal counts": lambda: register_points(box, box[:4], **FRAMES),
        "one pose repeated (pivot)": lambda: calibrate_pivot([pose] * 20),
        "one pose repeated (spin)": lambda: calibrate_spin([pose] * 20, tip_mm=[0, 0, 100.0]),
        "one pose repeated (robot-world)": lambda: solve_robot_world([pose] * 9, [pose] * 9),
    }
    for name, call in cases.items():
        try:
            call()
        except RegistrationError as error:
            yield Figure("bad input", name, f"{type(error).__name__}: {error}", "", "", True)
        else:
            yield Figure("bad input", name, "no error", "a typed error", "", False)
