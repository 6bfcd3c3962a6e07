"""Draws the meshes of the touch arm: ``python make_meshes.py [FOLDER]`` writes binary STL, in mm.

Everything is one construction, `loft`: closed rings of equally many points, stacked and capped.
A body is one such solid or several that overlap. Same numbers, same bytes, whenever it runs.
"""

import itertools
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Outline = Callable[[float], Array]

SIDES = 32


def loft(rings: Sequence[Array]) -> Array:
    """Triangles (m, 3, 3) of the closed solid through rings (n, 3) counter-clockwise about +z.

    The lowest ring comes first.
    """

    def fan(ring: Array) -> Array:
        centre = np.broadcast_to(ring.mean(axis=0), ring.shape)
        return np.stack([centre, ring, np.roll(ring, -1, axis=0)], axis=1)

    triangles = [fan(rings[0])[:, ::-1]]
    for low, high in itertools.pairwise(rings):
        low_next, high_next = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
        triangles.append(np.stack([low, low_next, high_next], axis=1))
        triangles.append(np.stack([low, high_next, high], axis=1))
    triangles.append(fan(rings[-1]))
    return np.concatenate(triangles)


def rounded(outline: Outline, low: float, high: float, bevel: float) -> Array:
    """An outline, given by how far it is inset, between two heights, its edges rounded off."""
    quarter = np.linspace(0.0, math.pi / 2.0, 4)
    inset, rise = bevel * (1.0 - np.sin(quarter)), bevel * (1.0 - np.cos(quarter))
    rings = [*zip(low + rise, inset, strict=True)]
    rings += [*zip(high - rise[::-1], inset[::-1], strict=True)]
    return loft([_at_height(outline(inward), height) for height, inward in rings])


def turned(profile: Sequence[tuple[float, float]], sides: int = SIDES) -> Array:
    """A profile of (radius, height), heights rising, turned about z."""
    return loft([_at_height(_circle(radius, sides), height) for radius, height in profile])


def tapered(length: float, radius: float, end_radius: float) -> Outline:
    """The hull of two circles, at 0 and at ``length`` on x, as an outline to inset."""
    lean = math.asin((radius - end_radius) / length)
    around = math.pi / 2.0 - lean

    def outline(inset: float) -> Array:
        back = np.linspace(around, math.tau - around, SIDES // 2)
        front = np.linspace(-around, around, SIDES // 2)
        first = (radius - inset) * np.stack([np.cos(back), np.sin(back)], 1)
        second = (end_radius - inset) * np.stack([np.cos(front), np.sin(front)], 1)
        return np.concatenate([first, second + np.array([length, 0.0])])

    return outline


def rounded_rectangle(depth: float, width: float, corner: float, forward: float) -> Outline:
    """A rectangle with round corners around (``forward``, 0), as an outline to inset."""

    def outline(inset: float) -> Array:
        angles = np.linspace(0.0, math.pi / 2.0, SIDES // 4)
        corners = []
        for quarter, (x, y) in enumerate([(1, 1), (-1, 1), (-1, -1), (1, -1)]):
            turn = angles + quarter * math.pi / 2.0
            arc = (corner - inset) * np.stack([np.cos(turn), np.sin(turn)], 1)
            centre = (x * (depth / 2.0 - corner) + forward, y * (width / 2.0 - corner))
            corners.append(arc + centre)
        return np.concatenate(corners)

    return outline


def disc(radius: float) -> Outline:
    """A circle, as an outline to inset."""
    return lambda inset: _circle(radius - inset, SIDES)


def z_to_y(points: Array) -> Array:
    """Lay what stands on z along y."""
    return points[..., [0, 2, 1]] * (1.0, 1.0, -1.0)


def x_to_down(points: Array) -> Array:
    """Turn x to down; thickness along y stays."""
    return points[..., [2, 1, 0]] * (1.0, 1.0, -1.0)


def tipped_back(points: Array) -> Array:
    """Turn z to -x."""
    return points[..., [2, 1, 0]] * (-1.0, 1.0, 1.0)


def moved(points: Array, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Array:
    """Shift by (x, y, z)."""
    return points + np.array([x, y, z])


def _circle(radius: float, sides: int) -> Array:
    angle = np.linspace(0.0, math.tau, sides, endpoint=False)
    return radius * np.stack([np.cos(angle), np.sin(angle)], 1)


def _at_height(outline: Array, height: float) -> Array:
    return np.column_stack([outline, np.full(len(outline), height)])


def base() -> Array:
    """The foot on the table, up to the turntable at 80 mm."""
    foot = rounded(rounded_rectangle(190.0, 150.0, 48.0, 10.0), 0.0, 26.0, 8.0)
    column = turned(
        [(66, 18), (66, 30), (61, 40), (56, 52), (53, 64), (52, 74), (51, 78), (48, 79)]
    )
    dock = turned([(13, 20), (13, 34), (11, 37), (7, 38), (6, 37)])
    return np.concatenate([foot, column, moved(dock, x=84.0)])


def base_collision() -> Array:
    """One simple solid around the base."""
    return loft(
        [
            _at_height(rounded_rectangle(190.0, 150.0, 48.0, 10.0)(inset), height)
            for inset, height in ((0.0, 0.0), (0.0, 38.0), (12.0, 42.0), (22.0, 79.0))
        ]
    )


def torso() -> Array:
    """The turret, from the turntable to above the shoulder's axis at 70 mm."""
    radii = [(50, 0), (54, 3), (55, 10), (54, 22), (49, 34), (41, 46), (34, 58), (30, 70)]
    return turned([*radii, (28, 82), (24, 92), (17, 99), (8, 102.5), (2, 103)])


def torso_collision() -> Array:
    """The turret with few sides, around the fine one."""
    return turned([(57, 0), (57, 26), (36, 60), (30, 88), (12, 104)], sides=20)


def hub() -> Array:
    """The shoulder's drum, along z around the axis."""
    return rounded(disc(28.0), -38.0, 38.0, 4.0)


def upper_arm() -> Array:
    """From the shoulder to the elbow along x."""
    beam = rounded(tapered(133.35, 22.0, 17.0), -11.0, 11.0, 4.0)
    shoulder, elbow = rounded(disc(21.0), -15.0, 15.0, 3.0), rounded(disc(15.0), -15.0, 15.0, 3.0)
    return z_to_y(np.concatenate([beam, shoulder, moved(elbow, x=133.35)]))


def forearm() -> Array:
    """From the elbow down to the wrist's sleeve."""
    beam = x_to_down(z_to_y(rounded(tapered(92.0, 13.0, 9.0), -8.0, 8.0, 3.5)))
    elbow = z_to_y(rounded(disc(13.0), -19.0, 19.0, 3.0))
    rod = turned([(5, -101), (6.5, -100), (8.0, -96), (8.0, -84), (6, -80)])
    return np.concatenate([beam, elbow, rod])


def wrist() -> Array:
    """The sleeve on the forearm's end and the fork that holds the gimbal's pins."""
    sleeve = turned([(7, 27), (9.5, 28), (10, 30), (10, 40), (9.5, 42), (7, 43)])
    bridge = rounded(rounded_rectangle(16.0, 40.0, 5.0, 0.0), 22.0, 30.0, 2.5)
    cheek = x_to_down(z_to_y(rounded(tapered(26.0, 8.0, 8.0), -2.5, 2.5, 1.2)))
    return np.concatenate(
        [sleeve, bridge, moved(cheek, y=17.0, z=26.0), moved(cheek, y=-17.0, z=26.0)]
    )


def gimbal() -> Array:
    """The ring around the pen, along -x, and its two pins along y."""
    ring = tipped_back(rounded(disc(11.5), -8.0, 8.0, 2.5))
    pin = z_to_y(turned([(4, -21), (4.5, -20), (4.5, 20), (4, 21)], sides=24))
    return np.concatenate([ring, pin])


def stylus() -> Array:
    """The pen: tip at 0, body along -z."""
    return turned(
        [
            *((4.5, -168), (6.6, -165), (7.6, -160), (8.0, -150), (8.2, -120), (8.4, -90)),
            *((8.2, -70), (7.6, -55), (7.0, -40), (6.0, -28), (4.4, -18), (3.0, -10), (2.0, -5)),
            *((1.6, -1.6), (1.1, -0.5), (0.4, 0.0)),
        ],
        sides=32,
    )


def stylus_collision() -> Array:
    """The pen with few sides, around the fine one."""
    return turned([(8.7, -168.5), (8.7, -55), (6.4, -26), (2.2, -4), (0.6, 0.0)], sides=16)


def button() -> Array:
    """A push button whose top looks along x."""
    top = rounded(rounded_rectangle(13.0, 6.0, 2.5, 0.0), -1.0, 2.0, 1.0)
    return top[..., [2, 1, 0]] * (1.0, -1.0, 1.0)


BODIES = (
    *(base, base_collision, torso, torso_collision, hub, upper_arm, forearm, wrist, gimbal),
    *(stylus, stylus_collision, button),
)


def binary_stl(triangles: Array) -> bytes:
    """The file of triangles (m, 3, 3) with their normals; mm, rounded to a nanometre."""
    # + 0.0 so that no -0.0 is written: it would be another byte for the same number.
    corners = np.round(triangles, 6) + 0.0
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    records = np.zeros(len(corners), dtype=[("floats", "<f4", 12), ("attribute", "<u2")])
    records["floats"][:, :3] = np.round(normals, 6) + 0.0
    records["floats"][:, 3:] = corners.reshape(-1, 9)
    header = b"MarginGuard touch arm, binary STL, mm".ljust(80)
    return header + np.uint32(len(records)).astype("<u4").tobytes() + records.tobytes()


def write_meshes(folder: Path) -> None:
    """Write every body to ``folder``/NAME.stl."""
    folder.mkdir(parents=True, exist_ok=True)
    for body in BODIES:
        (folder / f"{body.__name__}.stl").write_bytes(binary_stl(body()))


if __name__ == "__main__":
    write_meshes(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).parent / "meshes")
