"""``marginguard view FOLDER`` in a browser and over HTTP: list, compare, upload, open."""

import http.client
import json
import re
import signal
import socket
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, Page, expect

from app.fixture import MarginState
from tests.cli.small_case import write_small_case
from tests.page_rules import violations
from tests.viewer.attacks.raw_page import cookie
from tests.viewer.conftest import TOKEN, VIEW_TOKEN, Server

pytestmark = pytest.mark.long

NO_TOOL = "case.yaml: tool is missing; expected the tracked tool"

WAIT_MS = 90_000
SIZES = ((1280, 720), (1920, 1080), (390, 844))


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("library") / "cases"
    folder.mkdir()
    write_small_case(folder / "first")
    write_small_case(folder / "second", lambda values: values["margins"].update(stop_mm=2.0))
    (folder / "broken").mkdir()
    (folder / "broken" / "case.yaml").write_text("schema: 1\n")
    return folder


@pytest.fixture(scope="module")
def server(can_draw: None, root: Path) -> Iterator[Server]:
    log = root.parent / "log.txt"
    started = Server([str(root), "--max-upload-mb", "1"], log)
    yield started
    started.close()


@pytest.fixture
def page(browser: Browser, server: Server) -> Iterator[Page]:
    """The list with all cases replayed; errors of its scripts fail the test."""
    context = browser.new_context(viewport={"width": 1280, "height": 720})
    page, errors = context.new_page(), []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(server.url)
    expect(page.locator("#cases > li")).not_to_have_count(0)
    expect(page.locator("[data-state=computing]")).to_have_count(0, timeout=WAIT_MS)
    yield page
    assert errors == []
    context.close()


def zipped(path: Path, case: Path) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as made:
        for file in case.iterdir():
            made.write(file, f"day/{file.name}")
    return path


def answer(
    server: Server,
    token: str,
    method: str,
    path: str,
    data: bytes = b"",
    *,
    claimed: int | None = None,
) -> tuple[int, Any]:
    """Status and JSON of a request with the cookie of ``token``.

    ``claimed``: the stated length of a body, of which only ``data`` is sent.
    """
    link = http.client.HTTPConnection(server.host, timeout=WAIT_MS / 1000)
    try:
        link.putrequest(method, path)
        link.putheader("Cookie", cookie(server, token))
        link.putheader("Content-Length", str(len(data) if claimed is None else claimed))
        link.endheaders(data)
        found = link.getresponse()
        content = found.read()
        is_json = found.headers.get_content_type() == "application/json"
        return found.status, json.loads(content) if is_json else content
    finally:
        link.close()


def test_cases_are_listed_and_two_are_compared(page):
    card = page.locator("#cases > li", has=page.locator("[name=first]"))
    expect(card.locator("dl")).to_contain_text("Breaches1")
    expect(card.locator("dl")).to_contain_text("Deepest point-2.97 mm")
    page.wait_for_function("document.querySelector('#cases img').naturalWidth > 100")
    expect(page.locator(".state[data-state=failed]")).to_have_text(NO_TOOL)
    expect(page.locator("#compare")).to_be_disabled()
    page.check("[name=first]")
    page.check("[name=second]")
    page.click("#compare")
    differs = page.locator("#comparison tr[data-differs] th[scope=row]").all_inner_texts()
    assert {"Folder", "Stop margin"} <= set(differs) <= {"Folder", "Stop margin", "Changed"}
    expect(page.locator("#comparison tr", has_text="Stop margin")).to_have_text(
        "Stop margin1.00 mm2.00 mm"
    )
    label = MarginState.POSITIVE.display.label
    expect(page.locator("#comparison tr", has_text=f"Time {label}")).to_have_text(
        re.compile(rf"Time {label}\d\.\d s\d\.\d s")
    )
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        assert violations(page) == []
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_upload_is_checked_and_appears(page, root, tmp_path):
    case = zipped(tmp_path / "case.zip", write_small_case(tmp_path / "case"))
    page.click("#upload summary")
    page.set_input_files("#upload-file", str(case))
    expect(page.locator("#upload-name")).to_have_value("case")
    page.fill("#upload-name", "third")
    page.click("#upload-send")
    expect(page.locator("[name=third]")).to_be_visible(timeout=WAIT_MS)
    assert (root / "third" / "case.yaml").is_file()
    expect(page.locator("#problem")).to_be_empty()
    page.click("#upload summary")
    page.set_input_files("#upload-file", str(case))
    page.fill("#upload-name", "first")
    page.click("#upload-send")
    expect(page.locator("#problem")).to_contain_text("already exists; refusing to overwrite it")
    assert violations(page) == []


def test_bad_uploads_leave_nothing(server, root, tmp_path):
    before = sorted(path.name for path in root.iterdir())
    case = write_small_case(tmp_path / "case")
    (case / "tracking.igs.mha").write_text("no header")
    sound, broken = b"no zip", zipped(tmp_path / "a.zip", case).read_bytes()
    for name, data, problem in (
        ("new", sound, "damaged"),
        ("new", broken, "tracking.igs.mha"),
        ("..%2Fnew", broken, "the name is"),
        (".new", broken, "the name is"),
        ("first", broken, "already exists"),
    ):
        status, found = answer(server, TOKEN, "POST", f"/upload/{name}", data)
        assert status == 409 and problem in found["problem"], (name, found)
    status, found = answer(server, TOKEN, "POST", "/upload/new", claimed=(1 << 20) + 1)
    assert status == 409 and "larger than 1 MiB" in found["problem"]
    assert sorted(path.name for path in root.iterdir()) == before
    assert not (root.parent / "new").exists()


def test_viewer_sees_and_opens_nothing(server, root):
    status, found = answer(server, VIEW_TOKEN, "GET", "/library.json")
    assert status == 200 and not found["operates"] and found["max_upload_bytes"] == 0
    for path in ("/open/first", "/upload/new"):
        assert answer(server, VIEW_TOKEN, "POST", path, b"x")[0] == 403
    for path in ("/library.json", "/index.html", "/picture/first", "/marginguard/library.js"):
        assert answer(server, "wrong", "GET", path)[0] == 403
    for name in ("other", "..%2Fcases", "broken%00"):
        status, found = answer(server, TOKEN, "POST", f"/open/{name}")
        assert status == 409 and "not in the library" in found["problem"]
    status, found = answer(server, TOKEN, "POST", "/open/broken")
    assert status == 409 and found["problem"] == NO_TOOL


def test_case_is_opened_in_the_replay_page(page, browser, server):
    page.click("[aria-label='Open first']")
    page.wait_for_selector("body:not([data-lost]) #state-label", timeout=WAIT_MS)
    expect(page.locator(".case")).to_have_text("small")
    expect(page.locator("#role")).to_have_count(0)
    context = browser.new_context()
    viewer = context.new_page()
    viewer.goto(server.view_url)
    viewer.click("text=Go to its page", timeout=WAIT_MS)
    viewer.wait_for_selector("body:not([data-lost]) #state-label", timeout=WAIT_MS)
    expect(viewer.locator("#role")).to_have_text("VIEW ONLY")
    context.close()


def test_library_ends_with_its_pages(server):
    status, found = answer(server, TOKEN, "POST", "/open/second")
    assert status == 200
    server.process.send_signal(signal.SIGINT)
    assert server.process.wait() == 130
    assert "Traceback" not in server.log.read_text()

    page = urlsplit(found["url"])
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((page.hostname, page.port), 60.0)
