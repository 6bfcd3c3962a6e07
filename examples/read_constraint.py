"""Read the constraints of a running session in mm, and limit a velocity with each.

Start a session in another terminal, then this one. Expect ten lines: state, signed distance, and
how fast the tool may approach of the 30 mm/s that a hand asks for. It takes the planes as those of
now, which is enough to print: what moves a tool uses `mg.FixtureRule`.

    marginguard replay package://marginguard/recorded_case --rate 1
    python examples/read_constraint.py [TOPIC]
"""

import sys
from itertools import islice

import numpy as np

import marginguard as mg

topic = sys.argv[1] if len(sys.argv) > 1 else "/marginguard/constraint"
parameters = mg.LimiterParameters()

with mg.constraint_stream(topic, timeout_s=30.0) as constraints:
    for received in islice(constraints, 10):
        planes = received.constraint
        if planes is None:  # no plane is known yet: no motion is allowed
            print(f"{received.seq}: {received.state.name}, no planes ({received.reasons[0]})")
            continue
        hand = np.concatenate([-30.0 * planes.normals[0], np.zeros(3)])
        allowed = mg.limit_twist(hand, planes, planes.points_on_tool_mm[0], parameters)
        approach_mm_s = -planes.normals[0] @ allowed[:3] + 0.0
        distance = received.signed_distance_mm
        shown = "unknown" if distance is None else f"{distance:+.2f} mm"
        print(f"{received.seq}: {received.state.name} {shown}, approach {approach_mm_s:.1f} mm/s")
