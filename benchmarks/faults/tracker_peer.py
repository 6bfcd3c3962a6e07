"""Process of `benchmarks.faults` that sends a tracker's poses and a robot's joints, plain rclpy.

    python -m benchmarks.faults.tracker_peer SCENE.json [STATE [NODE]]

Reads changes as lines of JSON from standard input, ``{"set": {KEY: VALUE}, "when": "moving"}``.
Prints events as lines of JSON: ``ready``, ``first`` at the first sample, and ``set`` for each
change, with the times of the last sample before it and of the first with it. STATE is the initial
state as JSON. Imports nothing of ``app``.

Keys, each off with null: ``joints`` (false: not sent), ``joint_offset_rad`` of the first joint,
``silent`` (children that are not sent), ``status`` and ``nan`` of the tool, ``shift_ms`` of the
stamps of ``shifted`` children, ``offset_mm`` and ``creep_mm_s`` of the tool away from the tumour,
``turn_deg`` of the tool about its x axis, ``swap`` of tool and tumour, ``frozen`` tool, ``rest``
(the true motion stands still). At the start only: ``shift`` (frames by which the motion is late),
``poses`` (false: no publisher of poses), ``wait`` (for a line of input before the publishers);
with ``joints`` false there is no publisher of joints.
"""

import json
import queue
import sys
import threading
import time
from pathlib import Path

import numpy as np
import rclpy
from marginguard_msgs.msg import TrackedTransform
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState

from benchmarks.harness.peer import emit, set_time, to_and_fro

TOOL, TUMOR = 2, 1
NOISE_M = 0.02e-3
MOVING_MM_S, STILL_MM_S = 40.0, 15.0


class Tracker:
    """Publishes frame after frame; `state` holds the faults."""

    def __init__(self, scene, state, name):
        self.scene = scene
        self.frames = scene["frames"]
        self.state = state
        self.first = True
        self.changes = queue.SimpleQueue()
        self.pending = None
        self.shift = state.get("shift", 0)
        self.rest_at = None
        self.direction = None if "offset_mm" not in state else np.array(self.frames[0]["away"])
        self.creep_from_ns = 0
        self.frozen = None
        self.last_ns = 0
        self.random = np.random.default_rng(1)
        self.node = rclpy.create_node(name)
        self.poses = self.joints = None

    def join(self):
        """Create the publishers, after a line of input if so configured; False at its end."""
        state = self.state
        emit("ready")
        if state.get("wait") and "end" in self.changes.get():
            return False
        # A second sender of one kind must not appear as one of the other kind.
        if state.get("poses") is not False:
            self.poses = self.node.create_publisher(TrackedTransform, "/tracked_transforms", 100)
        if state.get("joints") is not False:
            self.joints = self.node.create_publisher(JointState, "/joint_states", 100)
        return True

    def run(self):
        period_ns, begin_ns = self.scene["period_ns"], self.scene["begin_ns"]
        beat = (time.time_ns() - begin_ns) // period_ns + 1
        while self.node.context.ok():
            due_ns = begin_ns + beat * period_ns
            time.sleep(max(0, due_ns - time.time_ns()) / 1e9)
            # A late process skips frames: the motion is a function of time.
            beat = max(beat, (time.time_ns() - begin_ns) // period_ns)
            if not self.send(beat, begin_ns + beat * period_ns):
                return
            beat += 1

    def send(self, beat, stamp_ns):
        """Send the frame ``beat``; False at the end of the input."""
        frame_number = beat - self.shift if self.rest_at is None else self.rest_at
        frame = self.frames[to_and_fro(frame_number, len(self.frames))]
        changed = self.take_change(frame, frame_number, beat, stamp_ns)
        if changed is None:
            return False
        state = self.state
        poses = self.sensed(frame, stamp_ns)
        silent = state.get("silent") or []
        shifted = state.get("shifted") or [child for _, child in self.scene["edges"]]
        shift_ns = int((state.get("shift_ms") or 0) * 1e6)
        now_ns = time.time_ns()
        for index, (parent, child) in enumerate(self.scene["edges"]):
            if child in silent or self.poses is None:
                continue
            message = TrackedTransform()
            set_time(message.header.stamp, stamp_ns + (shift_ns if child in shifted else 0))
            message.header.frame_id, message.child_frame_id = parent, child
            if index == TOOL:
                message.status = state.get("status") or 0
            fill(message.transform, poses[index])
            self.poses.publish(message)
        if state.get("joints") is not False and self.joints is not None:
            positions = list(frame["joints"])
            positions[0] += state.get("joint_offset_rad") or 0.0
            joints = JointState(name=self.scene["joint_names"], position=positions)
            set_time(joints.header.stamp, stamp_ns - self.scene["joint_offset_ns"])
            self.joints.publish(joints)
        if changed or self.first:
            event = "first" if self.first else "set"
            where = {"shift": self.shift, "rest_at": self.rest_at}
            emit(event, ns=now_ns, last_ns=self.last_ns, **where)
            self.first = False
        if not silent:
            self.last_ns = stamp_ns
        return True

    def take_change(self, frame, frame_number, beat, stamp_ns):
        """Apply a change that is due; True if one was applied, None at the end of the input."""
        if self.pending is None:
            try:
                self.pending = self.changes.get_nowait()
            except queue.Empty:
                return False
        if "end" in self.pending:
            return None
        speed, when = frame["speed_mm_s"], self.pending.get("when")
        if (when == "moving" and speed < MOVING_MM_S) or (when == "still" and speed > STILL_MM_S):
            return False
        change, self.pending = self.pending["set"], None
        self.state.update(change)
        if "rest" in change:
            if change["rest"]:
                self.rest_at = frame_number
            elif self.rest_at is not None:
                self.shift, self.rest_at = beat - self.rest_at, None
        if "creep_mm_s" in change or "offset_mm" in change:
            self.direction, self.creep_from_ns = np.array(frame["away"]), stamp_ns
        if "frozen" in change:
            self.frozen = self.noisy(frame) if change["frozen"] else None
        return True

    def noisy(self, frame):
        poses = [np.array(pose) for pose in frame["edges"]]
        for pose in poses:
            pose[:3] += NOISE_M * self.random.standard_normal(3)
        return poses

    def sensed(self, frame, stamp_ns):
        """The poses that are sent, (7,) each: m and xyzw."""
        state, poses = self.state, self.noisy(frame)
        tool = poses[TOOL]
        if self.frozen is not None:
            tool[:] = self.frozen[TOOL]
        if state.get("offset_mm"):
            tool[:3] += state["offset_mm"] / 1000.0 * self.direction
        if state.get("creep_mm_s"):
            crept_s = (stamp_ns - self.creep_from_ns) / 1e9
            tool[:3] += state["creep_mm_s"] / 1000.0 * crept_s * self.direction
        if state.get("turn_deg"):
            turn = Rotation.from_euler("x", state["turn_deg"], degrees=True)
            tool[3:] = (Rotation.from_quat(tool[3:]) * turn).as_quat()
        if state.get("swap"):
            poses[TOOL], poses[TUMOR] = poses[TUMOR], poses[TOOL]
        if state.get("nan"):
            poses[TOOL] = np.full(7, np.nan)
        return poses


def fill(transform, pose):
    to, by = transform.translation, transform.rotation
    to.x, to.y, to.z, by.x, by.y, by.z, by.w = map(float, pose)


def main():
    scene = json.loads(Path(sys.argv[1]).read_text())
    rclpy.init()
    state = json.loads(sys.argv[2]) if len(sys.argv) > 2 else {}
    tracker = Tracker(scene, state, sys.argv[3] if len(sys.argv) > 3 else "tracker_peer")

    def read():
        for line in sys.stdin:
            tracker.changes.put(json.loads(line))
        tracker.changes.put({"end": True})

    threading.Thread(target=read, daemon=True).start()
    threading.Thread(target=lambda: rclpy.spin(tracker.node), daemon=True).start()
    if tracker.join():
        tracker.run()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
