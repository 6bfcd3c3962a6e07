"""Plans on a live page: a needle's cross-hair, the ghost of an approach, and an executed plan."""

import json
import re
import time

import numpy as np
import pytest
from playwright.sync_api import expect
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from app.bridge import RosNode
from app.bridge.messages import header_message
from app.bridge.topics import EXECUTED_PLAN, STREAM, Topic
from app.control import open_control
from app.geometry import Stamp, poses_in
from app.runtime import prepare_live
from tests.bridge.live.conftest import breach as breach
from tests.bridge.live.conftest import frames_file as frames_file
from tests.bridge.live.conftest import live_yaml as live_yaml
from tests.bridge.live.conftest import start as start
from tests.bridge.live.test_record_command import SENDER, TRACKED
from tests.page_rules import violations
from tests.planning.plan_files import write_approach, write_needle
from tests.viewer.conftest import watching
from tests.viewer.page_actions import choose, press, read, wait_for
from tests.viewer.pictures import picture
from tests.waiting import wait_until

pytestmark = pytest.mark.long


@pytest.fixture
def planned(serve_live, live_yaml, breach, tmp_path):
    """The page of a session with plans for it: along the tool, and 20 mm beside that."""
    config = live_yaml(TRACKED)
    content = prepare_live(config).content
    edges = [sample.transform for sample in breach[len(breach) // 2].poses]
    poses = poses_in("reference", edges)
    tip = poses["cautery"] @ content.tool_from_tip
    pose = poses[content.frame_from_tumor.target] @ content.frame_from_tumor
    x, _, z = tip.rotation.T
    ends = [
        ((target - 60.0 * z).tolist(), target.tolist())
        for target in (tip.translation_mm + aside_mm * x + 5.0 * z for aside_mm in (3.0, 20.0))
    ]
    needle = write_needle(tmp_path / "needle.json", content.setup_id, pose, *ends, window_mm=20.0)
    robot = content.robot.robot
    approach = write_approach(tmp_path / "approach.json", robot, content.setup_id)
    return serve_live(config, "--needle", str(needle), "--approach", str(approach)), approach


@pytest.mark.timeout(900)
def test_page_guides_the_needle_and_shows_the_ghost(
    browser, planned, start, frames_file, domain_id
):
    server, approach = planned
    with watching(browser, server) as watched:
        page = watched.page
        start(str(SENDER), str(frames_file), "tracked", "again")
        choose(page, "operate")
        expect(page.locator("#guidance-gate")).to_contain_text(re.compile("gate (open|closed)"))
        expect(page.locator("#guidance-lateral")).to_contain_text(" mm")
        expect(page.locator("#crosshair text")).to_have_count(4)
        tip = read(page, "trame.state.get('guidance').tip")
        assert np.hypot(*tip) < 12.0
        page.select_option("#corridor", "1")
        wait_for(
            page,
            "(trame.state.get('guidance').tip ?? [0, 0]).some((each) => Math.abs(each) === 12)",
        )

        nearest, place = page.locator("#approach-nearest"), page.locator("#approach-place")
        expect(nearest).to_have_text("20.0 mm from ball")
        expect(page.locator("#approach-time")).to_contain_text("0.90 of 0.90 s")
        place.focus()
        page.keyboard.press("Home")
        expect(nearest).to_have_text("30.0 mm from ball")
        expect(page.locator("#approach-time")).to_contain_text("0.00 of 0.90 s")
        assert violations(page) == []
        page.select_option("#corridor", "0")
        press(page, "2")
        page.locator("#approach-place").evaluate("each => each.value = 10")
        page.locator("#approach-place").dispatch_event("input")
        expect(nearest).to_have_text("25.0 mm from ball")
        picture(page, "plans", "#guidance")

        with watching(browser, server, server.view_url) as seen:
            expect(seen.page.locator("#approach-place")).to_be_disabled()
            expect(seen.page.locator("#approach-nearest")).to_have_text("25.0 mm from ball")

        title = page.locator("#approach .count")
        with RosNode("executor", domain_id=domain_id) as ros:
            plans = ros.publisher(EXECUTED_PLAN)
            plans.publish(String(data=approach.read_text()))
            expect(title).to_have_text("the arm executes this plan")
            expect(nearest).to_have_text("20.0 mm from ball")
            other = json.loads(approach.read_text()) | {"made_from": {"setup_id": "other"}}
            plans.publish(String(data=json.dumps(other)))
            refused = "plan: is of the setup 'other'; expected "
            expect(page.locator("#approach-problem")).to_contain_text(refused)
        expect(title).to_have_text("plan of a file")  # its node has left
        assert watched.errors == []


@pytest.fixture
def planner(start, domain_id, project_root):
    """``marginguard plan serve`` for an arm that stands beside the tumour; its joints (n,)."""
    world = project_root / "data" / "worlds" / "lumpectomy"
    description = open_control(world)
    with RosNode("arm", domain_id=domain_id) as arm:
        joints = arm.publisher(Topic(f"{description.arm}/measured_js", JointState, STREAM))
        names = list(description.tool.joints)
        at = {**dict.fromkeys(names, 0.0), "waist": 1.0, "shoulder": 0.6, "elbow": 0.3}

        def measure():
            header = header_message("", Stamp(time.time_ns()))
            joints.publish(JointState(header=header, name=names, position=list(at.values())))

        arm.every(0.005, measure)
        server = start("-m", "app.cli", "plan", "serve", world)
        server.line(lambda line: line.startswith("PLANS"))
        yield at


@pytest.mark.timeout(900)
def test_goal_is_moved_and_a_plan_to_it_is_shown(
    browser, planned, planner, start, frames_file, domain_id
):
    server, _ = planned
    with watching(browser, server) as watched:
        page = watched.page
        start(str(SENDER), str(frames_file), "tracked", "again")
        choose(page, "operate")
        page.fill("#goal-clearance", "1")

        def has_begun():  # as soon as the joints are known
            page.evaluate("document.getElementById('goal-begin')?.click()")
            return page.locator("#goal-place").count()

        wait_until(has_begun, pause_s=0.5)
        place = page.locator("#goal-place")
        expect(place).to_contain_text(" mm from the root of the robot")
        for step in ("#goal-step-2", "#goal-step-4"):  # aside and up, away from the tumour
            before = place.text_content()
            page.click(step)
            expect(place).not_to_have_text(before)
        before = place.text_content()
        page.evaluate("trame.trigger('goal_move', [[0, 35, 35], [0, 0, 0]])")
        expect(place).not_to_have_text(before)
        expect(page.locator("#goal-problem")).to_have_count(0)
        assert violations(page) == []
        picture(page, "goal", "#goal")
        page.click("#goal-plan")
        expect(page.locator("#goal-status")).to_have_text(
            "planned; nothing has moved", timeout=40_000
        )
        expect(page.locator("#approach .count")).to_have_text("plan to the goal")
        page.click("#goal-begin")
        page.evaluate("trame.trigger('goal_move', [[1000, 0, 0], [0, 0, 0]])")
        expect(page.locator("#goal-problem")).to_contain_text("out of reach: link 'stylus'")
        expect(page.locator("#goal-plan")).to_be_disabled()
        assert watched.errors == []
