"""A simulated tool that an operator calibrates: a live session, and a tracker that sends its poses.

    python -m tests.viewer.calibrated_tool FILE

The process sends poses with plain rclpy until standard input ends. ``FILE`` has the present motion:
``pivot`` (about the tip), ``narrow`` (the same within 6 degrees) or ``spin`` (about the shaft). Its
name is printed once the tool moves in this way, without a jump from the motion before.
"""

import sys
import threading
import time
from pathlib import Path

import numpy as np
import rclpy
import trimesh
import yaml
from marginguard_msgs.msg import TrackedTransform
from rclpy.qos import QoSProfile
from scipy.spatial.transform import Rotation

TIP_MM = np.array([7.0, -3.0, 112.0])
"""True tip in the frame of the sensor."""
SHAFT = np.array([0.10, 0.06, 1.0]) / np.linalg.norm([0.10, 0.06, 1.0])
"""True axis, away from the line between sensor and tip."""
KNOWN_MM = TIP_MM + np.array([2.0, -1.5, 2.5])
"""Tip of the configuration, 3.5 mm off."""
STYLUS, STYLUS_TIP_MM = "pointer", np.array([-5.0, 8.0, 141.0])
"""Frame of a stylus, which moves as the tool does, and its true tip in it."""
STYLUS_DIVOT_MM = np.array([-15.0, -25.0, 55.0])
DIVOT_MM = np.array([40.0, -20.0, 60.0])
RATE_HZ = 60.0
NOISE_MM, NOISE_RAD = 0.1, np.radians(0.05)
SETTLE_S, TURN_S = 0.25, 4.0
CONE_RAD = {"pivot": np.radians(32.0), "narrow": np.radians(3.0), "spin": 0.0}


def write_session(folder: Path, *, stylus: bool = False) -> Path:
    """Write ``live.yaml`` with its files to ``folder``, with or without a stylus."""
    folder.mkdir(parents=True)
    trimesh.creation.icosphere(subdivisions=3, radius=8.0).export(folder / "tumor.stl")
    rod = trimesh.creation.cylinder(radius=1.5, height=60.0, sections=24)
    rod.apply_translation([0.0, 0.0, -30.0])
    rod.export(folder / "rod.stl")
    tip = np.eye(4)
    tip[:3, 3] = KNOWN_MM
    values = {
        "schema": 1,
        "name": "calibrated tool",
        "provenance": {"kind": "simulated", "source": "made up", "licence": "none"},
        "source": {"tracked_transforms": {}, "clock": "host"},
        "tool": {
            "frame": "cautery",
            "mesh": {"path": "rod.stl", "units": "mm"},
            "tip_from": {"matrix": tip.ravel().tolist()},
        },
        "tumor": {
            "frame": "needle",
            "mesh": {"path": "tumor.stl", "units": "mm"},
            "pose": {"matrix": np.eye(4).ravel().tolist()},
        },
        "margins": {
            "stop_mm": 1.0,
            "warn_mm": 5.0,
            "k_tre": 2.0,
            "v_max_mm_s": 50,
            "stale_after_ms": 1000,
        },
    }
    if stylus:
        values["stylus"] = {"frame": STYLUS}
    path = folder / "live.yaml"
    path.write_text(yaml.safe_dump(values, sort_keys=False))
    return path


def move(file: Path, motion: str) -> None:
    """Let the simulated tool move in another way; the file is never empty."""
    new = file.with_suffix(".new")
    new.write_text(motion)
    new.replace(file)


class Tool:
    """The tool with its tip in the divot."""

    def __init__(self) -> None:
        self._seconds = self._cone_rad = self._roll_rad = 0.0
        self._motion = ""

    def move(self, motion: str, step_s: float) -> tuple[Rotation, np.ndarray]:
        """Rotation and position in mm of the sensor in the reference after another ``step_s``."""
        self._seconds += step_s
        self._cone_rad += (CONE_RAD[motion] - self._cone_rad) * step_s / SETTLE_S
        self._roll_rad += 2.0 * np.pi * step_s / TURN_S if motion == "spin" else 0.0
        settled = abs(CONE_RAD[motion] - self._cone_rad) < np.radians(0.02)
        if settled and motion != self._motion:
            self._motion = motion
            print(motion, flush=True)
        azimuth = 2.0 * np.pi * self._seconds / 3.0
        tilt = self._cone_rad * (0.6 + 0.4 * np.sin(2.0 * np.pi * self._seconds / 7.0))
        tilted = Rotation.from_rotvec(tilt * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))
        down = Rotation.from_rotvec([np.pi, 0.0, 0.0])
        rotation = tilted * down * Rotation.from_rotvec(self._roll_rad * SHAFT)
        return rotation, DIVOT_MM - rotation.apply(TIP_MM)


def main() -> None:
    """Send until standard input ends."""
    file = Path(sys.argv[1])
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    rclpy.init()
    node = rclpy.create_node("simulated_tracker_of_a_tool")
    poses = node.create_publisher(TrackedTransform, "/tracked_transforms", QoSProfile(depth=100))
    noise = np.random.default_rng(3)
    begin_ns, tick, moved = time.time_ns(), 0, Tool()
    while not ended.is_set():
        due_ns = begin_ns + round(tick * 1e9 / RATE_HZ)
        time.sleep(max(0, due_ns - time.time_ns()) / 1e9)
        tool = moved.move(file.read_text(), 1.0 / RATE_HZ)
        still = Rotation.identity()
        for name, (rotation, place_mm) in {
            "reference": (still, np.zeros(3)),
            "needle": (still, np.array([0.0, 0.0, 20.0])),
            "cautery": tool,
            STYLUS: (tool[0], STYLUS_DIVOT_MM - tool[0].apply(STYLUS_TIP_MM)),
        }.items():
            message = TrackedTransform(status=0)
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(due_ns, 10**9)
            message.header.frame_id, message.child_frame_id = "tracker", name
            move, turn = message.transform.translation, message.transform.rotation
            noisy = rotation * Rotation.from_rotvec(noise.normal(0.0, NOISE_RAD, 3))
            turn.x, turn.y, turn.z, turn.w = noisy.as_quat().tolist()
            measured = place_mm + noise.normal(0.0, NOISE_MM, 3)
            move.x, move.y, move.z = (measured / 1000.0).tolist()
            poses.publish(message)
        tick += 1
    rclpy.shutdown()


if __name__ == "__main__":
    main()
