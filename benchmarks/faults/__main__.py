"""Inject faults into a live session from outside, and judge what a controller is permitted.

Real processes: `marginguard live` with the shipped live.yaml, a peer that sends the tracker's poses
and the robot's joints of the recorded case, foreign nodes, and a controller that asks for 50 mm/s
towards the tumour 50 times a second. Only the bench knows the truth: where the tool is, and that a
fault was injected. A message is permissive if it allows an approach: a constraint without hold that
is still valid, or an answer with more than 10 mm/s towards the true tumour. Late ones were sent
more than 30 ms after the row's limit. Of a display's faults the longest gap between two constraints
counts, which may exceed that without a display by 10 ms. The whole matrix takes about 15 minutes.

Exit status 1 when a row that must be safe is not, or could not be measured. Rows without a second
source of truth are named as residual risks.
"""

from pathlib import Path

from benchmarks.harness.options import BenchParser
from benchmarks.ros_domain import own_ros


def main() -> int:
    parser = BenchParser("faults", __doc__)
    text = "only rows whose name contains a text, or matches it as a wildcard"
    parser.add_argument("--rows", nargs="+", default=[], metavar="TEXT", help=text)
    parser.add_argument("--list", action="store_true", help="list the rows and end")
    parser.number("--trials", 3, "per row")
    parser.number("--constraint-hz", 1000.0, "of the guard")
    text = "stale_after_ms of the guard (default: that of the shipped live.yaml)"
    parser.number("--stale-ms", None, text)
    parser.add_argument("--logs", type=Path, metavar="DIR", help="keep the programs' logs there")
    options = parser.parse_args()
    with own_ros(options.logs) as folder:
        from benchmarks.faults.run import run  # ROS reads the variables when it is loaded

        return run(options, folder)
