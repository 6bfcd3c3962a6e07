"""Process that replays a case and prints the margin of each step.

    replayed_margins.py CASE

One line of JSON each, in mm with all digits: ``stamps_ns`` of tool and tumour, ``pose`` (the 4x4
matrix ``tumor_from_tip``), ``distance_mm``, ``margin_mm`` (stop margin and the part of the
uncertainty in it), ``structures`` (name, state, distance and stop margin of each of several). Steps
without a known margin are left out.
"""

import json
import sys
import time
from pathlib import Path

from app.runtime import ReplayRun, prepare_case

EDGES = (("tracker", "cautery"), ("tracker", "needle"))


def plain(step):
    """The values of ``step``; None without a known margin."""
    decision = step.decision
    if decision.margin is None or decision.proximity is None or step.tumor_from_tip is None:
        return None
    return {
        "stamps_ns": [step.edges.measured[edge].stamp.ns for edge in EDGES],
        "pose": step.tumor_from_tip.matrix.tolist(),
        "distance_mm": decision.proximity.signed_distance_mm,
        "margin_mm": [decision.margin.stop_mm, decision.margin.tre_mm],
        "structures": [
            [
                each.name,
                each.decision.state.name,
                each.decision.proximity.signed_distance_mm,
                each.decision.margin.stop_mm,
            ]
            for each in step.structures
        ],
    }


def main() -> None:
    prepared = prepare_case(Path(sys.argv[1]))
    for step in ReplayRun(prepared, clock_ns=time.monotonic_ns).steps():
        values = plain(step)
        if values is not None:
            print(json.dumps(values))


if __name__ == "__main__":
    main()
