"""The planned motion: breaches of the planned depth for any shape, work that fills the duration."""

import numpy as np
import pytest

from app.geometry import Transform
from app.synthetic import Clearance, Tumour, tool_mesh
from app.synthetic.error_budget import Depths
from app.synthetic.scenario import plan_scenario

pytestmark = pytest.mark.slow

TUMOR_FROM_WORK = Transform.identity("tumor", "work")


def plan(seed, diameter_mm, depths, duration_s):
    tumour = Tumour.generate(np.random.default_rng([seed, 0])).with_diameter(diameter_mm)
    clearance = Clearance(tumour, tool_mesh())
    random = np.random.default_rng(1)
    return clearance, plan_scenario(tumour, clearance, TUMOR_FROM_WORK, depths, duration_s, random)


@pytest.mark.parametrize(
    ("seed", "diameter_mm", "depths", "duration_s"),
    [
        # Along the normal this tumour is at most 4.4 mm deep where the tool enters.
        (2, 20.0, Depths(), 50.0),
        (3, 8.0, Depths(1.75, 1.75, 1.75, 3.5), 600.0),
    ],
)
def test_planned_depths_are_reached_and_the_work_between_keeps_away(
    seed, diameter_mm, depths, duration_s
):
    clearance, scenario = plan(seed, diameter_mm, depths, duration_s)
    assert scenario.path.end_s == pytest.approx(duration_s, abs=0.5)
    start_s = scenario.breath_held_until_s + 3.0
    heights = np.array(
        [
            clearance.height_mm(scenario.path.at(t))
            for t in np.arange(start_s, scenario.path.end_s, 0.1 if duration_s < 60.0 else 0.7)
        ]
    )
    near = heights < 0.7 * depths.nearest_mm * clearance.distance_per_height
    # Three breaches with their approaches take some 6 s.
    assert near.mean() < 7.0 / (scenario.path.end_s - start_s)
    if duration_s < 60.0:
        times = start_s + 0.1 * np.flatnonzero(heights < 0.0)
        runs = np.split(times, np.flatnonzero(np.diff(times) > 1.0) + 1)
        assert len(runs) == 3
        for run, depth_mm in zip(
            runs, (depths.deep_mm, depths.brief_mm, depths.shaft_mm), strict=True
        ):
            around = np.arange(run[0], run[-1], 0.02)
            deepest = min(clearance.distance_mm(scenario.path.at(t)) for t in around)
            assert deepest == pytest.approx(-depth_mm, abs=0.05)
    assert 30.0 < scenario.crossing_speed_mm_s <= 45.0
