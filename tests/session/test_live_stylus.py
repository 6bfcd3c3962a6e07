"""A stylus or another tool in a live session in simulated time: it changes no step of the guard."""

import pytest

from app.fixture import MarginState, TipProximity
from app.geometry import Transform
from app.session.setup import OtherTool
from tests.doubles import sample
from tests.session.test_live import STALE_MS, SimulatedHost, track
from tests.session.tool_worlds import box


def stylus(at_ms, stamp_ms=None):
    return sample("tracker", "stylus", (5.0, 0.01 * at_ms, 0.0), stamp_ms or at_ms)


def beside_another_tool():
    """A session that also follows a box of 20 mm on the stylus, and warns within 18 mm of it."""
    tip = Transform.identity("stylus", "stylus_tip")
    model = TipProximity(box("stylus_tip", (20.0, 20.0, 20.0)))
    tool = OtherTool("left", tip, model, warn_mm=18.0)
    return SimulatedHost(shown_frames=("stylus",), other_tools=(tool,))


def guarded(steps):
    """Time, samples of tool and tumour, and decision of each step."""
    return [
        (
            at,
            step.frame.stamp,
            [(each.source, each.stamp) for each in step.frame.poses if each.source != "stylus"],
            step.decision.state,
            step.decision.reasons,
            step.decision.hold,
            step.decision.margin,
        )
        for at, step in steps
    ]


@pytest.mark.parametrize(
    ("stamps", "period_ms"),
    [
        (lambda at: at, 20),
        (lambda at: at, 7),  # more often than the others
        (lambda at: at, 150),  # stale between two samples
        (lambda at: at - 5_000, 20),  # of a clock that is behind
        (lambda at: at + 60_000, 20),  # of one that is ahead
        (lambda at: 1_000_000 - 50 * at, 20),  # of one that goes back
    ],
)
def test_a_stylus_changes_no_step_whatever_its_stamps(stamps, period_ms):
    hosts = beside_another_tool(), SimulatedHost()
    for host in hosts:
        track(host, 0, 400)
    for at_ms in range(1, 700, period_ms):
        hosts[0].arrive(at_ms + 2.0, stylus(at_ms, stamps(at_ms)))
    with_stylus, without = (host.run(800) for host in hosts)
    assert guarded(with_stylus) == guarded(without)
    assert any(each.source == "stylus" for _, step in with_stylus for each in step.frame.poses)
    assert hosts[0].live.left_out() == hosts[1].live.left_out()
    assert hosts[0].live.edges == hosts[1].live.edges


def test_a_stylus_is_placed_while_it_is_tracked_and_not_after():
    host = beside_another_tool()
    track(host, 0, 1000)
    for at_ms in range(0, 400, 20):
        host.arrive(at_ms + 2.0, stylus(at_ms))
    steps = [(at, step) for at, step in host.run(950) if at > 100]
    known = {at: step.edges.measured[("tracker", "stylus")] is not None for at, step in steps}
    assert max(at for at in known if known[at]) < 380 + STALE_MS + 40
    assert min(at for at in known if not known[at]) > 380
    pose, stamp = next(step for at, step in steps if at > 300).edges.between("needle", "stylus")
    assert pose.translation_mm[1] == pytest.approx(0.01 * 290, abs=0.3)
    assert stamp is not None
    tools = {at: step.tools[0] for at, step in steps}
    states = {at: tool.state is MarginState.WARNING for at, tool in tools.items()}
    assert states == known  # 15 mm away, or not known
    assert "is 15.0 mm away" in tools[min(tools)].text
    assert tools[max(tools)].warning == "distance of tool 'left' is not known (stale)"


def test_an_unknown_frame_is_not_collected():
    host = SimulatedHost(shown_frames=("pointer",))
    track(host, 0, 200)
    host.arrive(50.0, stylus(45))
    assert all(each.source != "stylus" for _, step in host.run(195) for each in step.frame.poses)
