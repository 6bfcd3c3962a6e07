"""Files that the page offers, and what they may cost."""

import asyncio
import threading
from functools import partial

import pytest
from aiohttp import web
from aiohttp.test_utils import make_mocked_request

from app.geometry import InputError
from app.viewer.downloads import Downloads

REQUEST = make_mocked_request("GET", "/")
REPORT = make_mocked_request("GET", "/report.html")


def test_pictures_of_all_pages_together_are_limited_in_rate():
    drawn = []

    def screenshot():
        drawn.append(1)
        return b"png"

    async def ask():
        downloads = Downloads(screenshot, {})
        return [(await downloads.screenshot(REQUEST)).status for _ in range(50)]

    statuses = asyncio.run(ask())
    assert statuses[:4] == [200] * 4
    assert statuses[-1] == 429
    assert len(drawn) == statuses.count(200) < 10


def test_report_is_computed_once_also_when_it_is_requested_at_once():
    computed, may_end = [], threading.Event()

    def report():
        computed.append(1)
        assert may_end.wait(120.0)
        return b"<p>report</p>"

    async def ask():
        downloads = Downloads(bytes, {"report.html": report})
        asked = [asyncio.create_task(downloads.export(REPORT)) for _ in range(5)]
        asked[0].cancel()  # its client has left
        await asyncio.sleep(0)
        may_end.set()
        return [(await each).body for each in asked[1:]]

    assert asyncio.run(ask()) == [b"<p>report</p>"] * 4
    assert len(computed) == 1


def test_export_is_computed_again_for_new_notes_one_at_a_time():
    running, made, notes = threading.Semaphore(1), [], [0]

    def make(name):
        assert running.acquire(blocking=False), "two exports at a time"
        made.append((name, notes[0]))
        running.release()
        return name.encode()

    names = ("margin.csv", "scene.mrb", "movie.gif", "report.pdf")
    downloads = Downloads(bytes, {n: partial(make, n) for n in names}, lambda: notes[0])

    async def ask(*names):
        requests = [make_mocked_request("GET", f"/{name}") for name in names]
        found = await asyncio.gather(*(downloads.export(each) for each in requests))
        headers = [each.headers["Content-Disposition"] for each in found]
        return [
            (each.body, each.content_type, header)
            for each, header in zip(found, headers, strict=True)
        ]

    found = asyncio.run(ask(*names))
    assert found[0] == (b"margin.csv", "text/csv", 'attachment; filename="margin.csv"')
    assert [kind for _, kind, _ in found[1:]] == ["application/zip", "image/gif", "application/pdf"]
    asyncio.run(ask("margin.csv"))
    notes[0] = 1
    asyncio.run(ask("margin.csv", "margin.csv"))
    assert sorted(made) == sorted([*((name, 0) for name in names), ("margin.csv", 1)])


def test_export_that_cannot_be_made_says_why():
    def make():
        raise InputError("no scene: the distance\nwas never known")

    async def ask():
        return await Downloads(bytes, {"report.html": make}).export(REPORT)

    answer = asyncio.run(ask())
    assert (answer.status, answer.text) == (409, "no scene: the distance was never known")


def test_session_without_exports_offers_none():
    with pytest.raises(web.HTTPNotFound):
        asyncio.run(Downloads(bytes, {}).export(REPORT))
