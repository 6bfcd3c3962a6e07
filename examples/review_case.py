"""Review a recorded case: margin states, breaches, and a plot.

Expect the number of frames in each state, three breaches of 2 to 6 mm, and the file margin.png.

    python examples/review_case.py [CASE] [--plot FILE]
"""

import argparse

import marginguard as mg

parser = argparse.ArgumentParser(description="Review a recorded case.")
parser.add_argument("case", nargs="?", default=mg.example_case(), help="default: the shipped case")
parser.add_argument("--plot", default="margin.png", metavar="FILE")
options = parser.parse_args()

case = mg.open_case(options.case)
steps = list(mg.replay(case))

table = mg.margin_table(steps)
for state, rows in table.groupby("state"):
    print(f"{state:8} {len(rows):5} frames")

for number, breach in enumerate(mg.find_breaches(case, steps), start=1):
    depth_mm = -breach.min_signed_distance_mm
    print(f"breach {number}: {breach.start_s:.2f} to {breach.end_s:.2f} s, {depth_mm:.1f} mm deep")

mg.plot_margin(case, steps).savefig(options.plot)
print(f"wrote {options.plot}")
