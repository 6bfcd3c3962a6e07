"""Independent ROS process that sends harmful messages, with plain rclpy.

    hostile.py TOPIC=TYPE ... [--flood SECONDS]

Prints ``ready`` when every topic has a subscriber. Then it reads an attack per line of standard
input, ``ATTACK TOPIC`` or ``ATTACK TOPIC PARENT CHILD`` to attack that edge, and prints
``done ATTACK COUNT SECONDS`` after each. It does not import the project.
"""

import math
import struct
import sys
import threading
import time

import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped, TwistStamped
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message

from tests.bridge.peers import edge_message, interface, stamped

TEN_MEGABYTES = 10_000_000
LONGER_THAN_ACCEPTED = 1_100_000
LAST_SECOND = 2**31 - 1
NAN = [math.nan] * 3
HUGE = [1e308] * 3
LATCHED = ("/tf_static", "/robot_description")


class Peer:
    def __init__(self, topics, flood_s):
        rclpy.init()
        self.node = rclpy.create_node("hostile")
        self.flood_s = flood_s
        self.types = {}
        self.publishers = {}
        self.unmatched = set(topics)
        self.matched = threading.Event()
        for name, kind in topics.items():
            self.types[name] = interface(kind)
            qos = QoSProfile(depth=100)
            if name in LATCHED:
                qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            self.publishers[name] = self.node.create_publisher(
                self.types[name],
                name,
                qos,
                event_callbacks=PublisherEventCallbacks(
                    matched=lambda _, name=name: self.on_matched(name)
                ),
            )

    def on_matched(self, name):
        self.unmatched.discard(name)
        if not self.unmatched:
            self.matched.set()

    def wait_until_matched(self):
        while not self.matched.is_set():
            rclpy.spin_once(self.node)

    def pose(self, name, parent, child, stamp=None, move=(0.0, 0.0, 0.0), turn=(0, 0, 0, 1)):
        """One transform in a message of the topic's type."""
        kind = self.types[name]
        message = TransformStamped() if hasattr(kind, "transforms") else kind()
        edge_message(message, parent, child, move, turn, time.time_ns())
        if stamp is not None:
            message.header.stamp.sec, message.header.stamp.nanosec = stamp
        return kind(transforms=[message]) if hasattr(kind, "transforms") else message

    def send(self, name, *messages):
        for message in messages:
            self.publishers[name].publish(message)
            time.sleep(0.002)  # the listener may keep only the last message of a burst
        return len(messages)

    def damaged_bytes(self, name):
        """Yield truncated and overwritten copies of a valid message.

        None is empty, because the middleware then delivers nothing of a burst.
        """
        good = serialize_message(self.pose(name, "evil", "worse"))
        yield from (good[:end] for end in range(4, len(good) - 1, 3))
        # Lengths and counts beyond the end of the message.
        yield from (
            good[:at] + struct.pack("<I", 2**32 - 1) + good[at + 4 :]
            for at in range(4, min(40, len(good) - 4), 4)
        )
        yield b"\x00\x01\x00\x00" + b"\xff" * 2000

    def twist(self, frame, linear=(0.0, 0.0, 0.05), angular=(0.0, 0.0, 0.0), late_s=0.0):
        """Velocity command in m/s and rad/s along the axes of ``frame``."""
        message = TwistStamped()
        message.header.frame_id = frame
        stamped(message, time.time_ns() - round(late_s * 1e9))
        to, by = message.twist.linear, message.twist.angular
        to.x, to.y, to.z = linear
        by.x, by.y, by.z = angular
        return message

    def command(self, what, name, frame):
        twist = self.twist
        if what == "flood":
            return self.flood(name, [twist(frame, HUGE), twist("nowhere"), twist(frame)])
        names = ["", " ", "/", "nowhere", "ä", "%s%n", "x" * 5000, "x" * TEN_MEGABYTES]
        lates_s = (3600.0, 1.0, -1.0, -3600.0, time.time())
        attacks = {
            "nan": lambda: [twist(frame, NAN), twist(frame, angular=NAN)],
            "huge": lambda: [twist(frame, HUGE), twist(frame, [math.inf] * 3)],
            "names": lambda: map(twist, names),
            "stamps": lambda: (twist(frame, late_s=late_s) for late_s in lates_s),
        }
        return self.send(name, *attacks[what]())

    def attack(self, what, name, parent, child):
        if self.types[name] is TwistStamped:
            return self.command(what, name, parent)
        now_s = time.time_ns() // 10**9

        def pose(parent=parent, child=child, *arguments, **values):
            return self.pose(name, parent, child, *arguments, **values)

        repeated = {
            "lost": lambda: pose(move=NAN),
            "skew": lambda: pose(turn=(0, 0, 0, 2)),
            "future": lambda: pose(stamp=(now_s + 3600, 0)),
        }
        if what in repeated:
            return self.repeat(name, repeated[what])
        if what == "flood":
            return self.flood(name, [pose()])
        if what == "frames":
            return self.flood(name, [pose(parent, f"evil_{i}") for i in range(5000)])
        names = ["", " ", "/", "a b", "a//b", "\n", "ä", "../../etc", "%s%n"]
        names += ["x" * 500, "x" * 5000]
        loops = [(parent, parent), (child, parent), ("l1", "l2"), ("l2", "l3"), ("l3", "l1")]
        stamps = [(0, 0), (now_s + 3600, 0), (LAST_SECOND, 2**32 - 1), (-LAST_SECOND - 1, 0)]
        stamps += [(now_s - 10, 0), (now_s - 20, 2**32 - 1)]
        turns = [(*NAN, 1.0), (0, 0, 0, 0), [*HUGE, 1.0]]
        attacks = {
            "nan": lambda: [pose(move=NAN), *(pose(turn=turn) for turn in turns)],
            "huge": lambda: [pose(move=HUGE)],
            "names": lambda: (
                *(pose(parent, bad) for bad in names),
                *(pose(bad, child) for bad in names),
            ),
            "loops": lambda: (pose(*edge) for edge in loops),
            "stamps": lambda: (pose(stamp=stamp) for stamp in stamps),
            "bytes": lambda: self.damaged_bytes(name),
            "long": lambda: self.long(name, parent),
            "good": lambda: [pose()],
        }
        if what in attacks:
            return self.send(name, *attacks[what]())
        return self.send(name, *(self.types[name](**each) for each in getattr(self, what)()))

    def long(self, name, parent):
        """Serialised once, because it is slow.

        The middleware loses most of the longest, because a socket buffer holds a few fragments; of
        the others some arrive.
        """
        for size in (TEN_MEGABYTES, LONGER_THAN_ACCEPTED):
            yield from [serialize_message(self.pose(name, parent, "x" * size))] * 60

    def urdf(self):
        yield {"data": "<robot name='arm'><link name='good_base'/></robot>"}

    def texts(self):
        bomb = "<!DOCTYPE r [<!ENTITY a 'aaaaaaaaaa'><!ENTITY b '&a;&a;&a;&a;&a;&a;&a;&a;'>]>"
        file = "<!DOCTYPE r [<!ENTITY f SYSTEM 'file:///etc/hostname'>]>"
        yield {"data": ""}
        yield {"data": "<robot"}
        yield {"data": f"{bomb}<robot name='&b;'><link name='&b;'/></robot>"}
        yield {"data": f"{file}<robot name='f'><link name='&f;'/></robot>"}
        yield {"data": "x" * TEN_MEGABYTES}

    def joints(self):
        names = ["a", "b"]
        yield {"name": names, "position": [1.0, 2.0]}
        yield {"name": names, "position": [math.nan, 2.0]}
        yield {"name": names, "position": [1.0]}
        yield {"name": ["a", "a"], "position": [1.0, 2.0]}
        yield {"name": names, "position": [math.inf, -math.inf]}

    def long_joints(self):
        yield {"name": ["x" * LONGER_THAN_ACCEPTED], "position": [0.0]}

    def longest_joints(self):
        yield {"name": ["x" * TEN_MEGABYTES], "position": [0.0]}

    def clock(self):
        for sec in (100, 0, LAST_SECOND, -LAST_SECOND, 5):
            yield {"clock": Time(sec=sec, nanosec=2**32 - 1)}

    def repeat(self, name, make):
        """Send for half a second with current stamps, since a valid sample may replace one."""
        for _ in range(100):
            self.send(name, make())
            time.sleep(0.005)
        return 100

    def flood(self, name, messages):
        """Send serialised messages at up to 10 kHz, as a compiled peer could."""
        raw = [serialize_message(message) for message in messages]
        publisher = self.publishers[name]
        begin = time.perf_counter()
        count = 0
        while (elapsed := time.perf_counter() - begin) < self.flood_s:
            if count > 10_000 * elapsed:
                time.sleep(0.0001)
                continue
            publisher.publish(raw[count % len(raw)])
            count += 1
        return count


def main() -> None:
    arguments = sys.argv[1:]
    flood_s = 1.0
    if "--flood" in arguments:
        at = arguments.index("--flood")
        flood_s = float(arguments[at + 1])
        del arguments[at : at + 2]
    peer = Peer(dict(argument.split("=") for argument in arguments), flood_s)
    peer.wait_until_matched()
    print("ready", flush=True)
    for line in sys.stdin:
        what, name, *edge = line.split()
        parent, child = edge or ("evil", "worse")
        begin = time.perf_counter()
        count = peer.attack(what, name, parent, child)
        print(f"done {what} {count} {time.perf_counter() - begin:.3f}", flush=True)


if __name__ == "__main__":
    main()
