"""``marginguard view``: refused arguments, and a live session in the browser."""

import re
import signal
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect
from playwright.sync_api import TimeoutError as PlaywrightTimeout

from app.cli.process import SignalState
from app.session import Session
from tests.cli.command import refused, run
from tests.viewer.attacks.raw_page import cookie, raw_page
from tests.viewer.attacks.test_messages_served import EXITS, FORGERIES
from tests.viewer.conftest import TOKEN, Server, Watched
from tests.viewer.conftest import viewed_case as viewed_case
from tests.viewer.page_actions import accepted as accepted_by_page
from tests.viewer.page_actions import choose
from tests.viewer.test_server_gone import check_lost

pytestmark = pytest.mark.long

SENDER = Path(__file__).parents[1] / "bridge" / "live" / "sender.py"


@pytest.mark.parametrize("option", ["--approach", "--needle"])
def test_file_that_is_no_plan_is_named(option, tmp_path):
    plan = tmp_path / "plan.json"
    plan.write_text("{}")
    error = refused("view", "data/recorded_case", option, plan)
    assert f"{plan}: is not a plan (KeyError: " in error


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["data/recorded_case", "--live"],
        ["--live"],
        ["--live", "--config", "live.yaml", "--node", "/marginguard"],
        ["--config", "live.yaml"],
        ["data/recorded_case", "--config", "live.yaml"],
    ],
)
def test_case_and_live_session_exclude_each_other(arguments):
    expected = "expected CASE, --live and --config FILE, or --live and"
    assert expected in refused("view", *arguments)


@pytest.mark.parametrize(
    "command", [["live"], ["view", "--live"]], ids=lambda command: " ".join(command)
)
def test_guard_of_the_tip_alone_is_refused(command):
    printed = run(*command, "--tip-only", "--config", "live.yaml", status=2)
    assert "a guard measures the whole tool; expected a " in printed.err


@pytest.mark.parametrize("option", ["--token", "--view-token"])
def test_empty_token_is_refused(option):
    assert f"{option} is empty" in refused("view", "data/recorded_case", option, "")


def test_tokens_of_the_two_roles_differ():
    error = refused("view", "data/recorded_case", "--token", "a", "--view-token", "a")
    assert "view token: the same as the other token" in error


def test_missing_case_is_refused_in_one_line(tmp_path):
    refused("view", tmp_path / "none")


@pytest.mark.parametrize(
    ("address", "named"),
    [
        (["--port", "65536"], "port: 65536"),
        (["--host", ""], "host: empty; expected"),
        (["--host", "192.0.2.1"], "192.0.2.1 port 0: Cannot assign"),
    ],
)
def test_invalid_address_is_reported_before_case_is_opened(tmp_path, address, named):
    assert named in refused("view", tmp_path / "none", *address)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_command_while_case_is_stepped_through(viewed_case, monkeypatch, number):
    noted = threading.Event()
    take, step = SignalState.take, Session.step
    stamps = []

    def take_and_tell(received, taken):
        take(received, taken)
        noted.set()

    def step_with_a_signal_at_the_third(session, frame):
        stamps.append(frame.stamp)
        if len(stamps) == 3:
            signal.raise_signal(number)
            assert noted.wait(30.0)
        return step(session, frame)

    monkeypatch.setattr(SignalState, "take", take_and_tell)
    monkeypatch.setattr(Session, "step", step_with_a_signal_at_the_third)
    printed = run("view", viewed_case, status=128 + number)
    assert len(stamps) == 3
    assert printed.out == ""  # no page was served


@pytest.fixture
def live_server(can_draw: None, domain_id: int, live_yaml, tmp_path: Path) -> Iterator[Server]:
    config = live_yaml({"tracked_transforms": {"topic": "/tracked_transforms"}, "clock": "host"})
    server = Server(["--live", "--config", str(config)], tmp_path / "view.txt")
    yield server
    server.close()


def rearm_on(page: Page) -> None:
    """End the hold by the page's button; again if poses that came late have begun another one."""
    request, accepted = page.locator("#request"), accepted_by_page("rearm")
    while True:
        page.locator("#rearm summary").click()
        with suppress(PlaywrightTimeout):  # the button of an earlier hold disappears
            page.locator("#rearm-confirm").click(timeout=2000)
        expect(request).to_contain_text("rearm from the page")
        if accepted.search(request.inner_text()):
            return


def test_live_session_is_shown_and_turns_grey_without_its_source(
    browser, live_server, start, frames_file
):
    context = browser.new_context(viewport={"width": 1280, "height": 720})
    watched = Watched(context.new_page(), live_server.host)
    page = watched.open(live_server.url)
    word = page.locator("#state-label")
    expect(page.locator(".mode")).to_have_text("LIVE")
    expect(word).to_have_text("UNKNOWN")
    sender = start(str(SENDER), str(frames_file), "tracked", "again")
    expect(word).to_have_text("IN TUMOUR", timeout=30_000)
    expect(page.locator("#distance")).to_contain_text("\N{MINUS SIGN}")
    expect(page.locator("#timeline .curve")).to_have_attribute("d", re.compile("^M.*L"))
    assert page.locator(".lamps [data-light=valid]").count() == 3
    with raw_page(live_server, cookie(live_server, TOKEN)) as attacker:
        attacker.greet()
        for method, args in EXITS + FORGERIES:
            assert "error" in attacker.call(method, *args)
    expect(word).to_have_text("IN TUMOUR")
    sender.end(signal.SIGKILL)
    expect(word).to_have_text("UNKNOWN")
    expect(page.locator("#distance")).to_have_text("\N{EN DASH}")
    expect(page.locator(".lamps [data-light=valid]")).to_have_count(0)
    expect(page.locator("#rearm")).to_have_count(0)
    start(str(SENDER), str(frames_file), "tracked", "again")
    expect(word).to_have_text("IN TUMOUR", timeout=30_000)
    expect(page.locator(".hold")).to_have_count(1)
    rearm_on(page)
    request = page.locator("#request")
    choose(page, "operate")
    page.click("#margins summary")
    stop = page.locator("#margins-stop")
    expect(stop).not_to_have_value("")
    stop_mm = float(stop.input_value())
    page.fill("#margins-stop", f"{stop_mm + 0.5:g}")
    page.click("#margins-confirm")
    expect(request).to_contain_text(accepted_by_page("set_margins", ": stop_mm"))
    page.fill("#note-text", "first cut")
    page.click("#note-add")
    expect(request).to_contain_text(accepted_by_page("note", r": first cut \(step "))
    expect(page.locator(".notes li")).to_contain_text("first cut")
    choose(page, "prepare", "contour")
    count = page.locator("#contour-count")
    while count.inner_text() == "no points":  # refused while a pose is late
        page.click("#contour-tip")
        page.wait_for_timeout(500)
    expect(count).to_have_text(re.compile(r"^\d+ points?, \d+ at the tip$"))
    assert watched.external_requests() == []
    assert watched.errors == []
    live_server.process.send_signal(signal.SIGINT)
    check_lost(page)
    assert live_server.process.wait() == 130
    lines = live_server.log.read_text().splitlines()
    refused = [line for line in lines if ": refused: " in line]
    assert len(refused) == len(EXITS + FORGERIES)
    others = [line for line in lines if line not in refused]
    # A trace of the server would be a line that is neither printed at start nor a record of the
    # session's log. How many records there are depends on how late the machine lets a step come.
    printed = ("ROS discovery", "audit log", "compiling for this machine")
    record = re.compile(r"\[(INFO|WARN)\] \[\d+\.\d+\] \[marginguard[^\]]*\]: ")
    assert all(record.match(line) or line.startswith(printed) for line in others), others
    context.close()
