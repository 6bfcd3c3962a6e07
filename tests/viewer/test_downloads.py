"""Files that the page offers, and what they may cost."""

import asyncio
import threading

import pytest
from aiohttp import web
from aiohttp.test_utils import make_mocked_request

from app.viewer.downloads import Downloads

REQUEST = make_mocked_request("GET", "/")


def test_pictures_of_all_pages_together_are_limited_in_rate():
    drawn = []

    def screenshot() -> bytes:
        drawn.append(1)
        return b"png"

    async def ask() -> list[int]:
        downloads = Downloads(screenshot, None)
        return [(await downloads.screenshot(REQUEST)).status for _ in range(50)]

    statuses = asyncio.run(ask())
    assert statuses[:4] == [200] * 4
    assert statuses[-1] == 429
    assert len(drawn) == statuses.count(200) < 10


def test_report_is_computed_once_also_when_it_is_requested_at_once():
    computed, may_end = [], threading.Event()

    def report() -> bytes:
        computed.append(1)
        assert may_end.wait(30.0)
        return b"<p>report</p>"

    async def ask() -> list[object]:
        downloads = Downloads(bytes, report)
        asked = [asyncio.create_task(downloads.report(REQUEST)) for _ in range(5)]
        asked[0].cancel()  # its client has left
        await asyncio.sleep(0)
        may_end.set()
        return [(await each).body for each in asked[1:]]

    assert asyncio.run(ask()) == [b"<p>report</p>"] * 4
    assert len(computed) == 1


def test_session_without_a_report_offers_none():
    with pytest.raises(web.HTTPNotFound):
        asyncio.run(Downloads(bytes, None).report(REQUEST))
