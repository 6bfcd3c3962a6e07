"""When pictures are drawn: one in flight, the newest state, none without clients, heartbeats."""

import asyncio

import numpy as np
import pytest

from app.viewer.drawing.pictures import RenderLoop


class Area:
    """Test double of an area: a small grey picture."""

    def set_high_quality(self, high_quality):
        self.high_quality = high_quality

    @property
    def img_cols_rows(self):
        return np.full((16, 16, 3), 90, np.uint8), 16, 16


class Source:
    """Test double of a page whose state changes at each call."""

    def __init__(self):
        self.states, self.pictures = 0, []
        self.drawn = asyncio.Event()

    def prepare(self):
        self.states += 1
        return True

    def sent(self, number):
        self.pictures.append((number, self.states))
        self.drawn.set()


class Beats:
    """Test double of a link: counts heartbeats."""

    def __init__(self):
        self.numbers = []
        self.changed = asyncio.Event()

    def __call__(self, number):
        self.numbers.append(number)
        self.changed.set()

    async def more(self, count):
        expected = len(self.numbers) + count
        while len(self.numbers) < expected:
            self.changed.clear()
            await self.changed.wait()


def run(scenario):
    async def within():
        source, beats = Source(), Beats()
        pictures = RenderLoop(Area(), source, beats)
        pushed = []
        pictures.set_push_callback(lambda content, meta: pushed.append((content[:2], meta)))
        loop = asyncio.create_task(pictures.run())
        try:
            await asyncio.wait_for(scenario(pictures, source, beats, pushed), 20.0)
        finally:
            loop.cancel()

    asyncio.run(within())


async def next_picture(source):
    source.drawn.clear()
    await source.drawn.wait()


def test_without_clients_nothing_is_drawn_but_heartbeats_continue():
    async def scenario(pictures, source, beats, pushed):
        await beats.more(4)
        assert len(source.pictures) == 1
        pictures.acknowledge("page", 0)
        await next_picture(source)
        assert len(source.pictures) == 2

    run(scenario)


def test_next_picture_waits_for_the_acknowledgement_and_shows_the_newest_state():
    async def scenario(pictures, source, beats, pushed):
        pictures.acknowledge("page", 0)
        await next_picture(source)
        pictures.acknowledge("page", source.pictures[-1][0])
        await next_picture(source)
        number = source.pictures[-1][0]
        assert number > 1  # below it is the number of a picture, not the 0 of a new page
        for _ in range(3):
            pictures.acknowledge("page", number - 1)
            await beats.more(1)
        assert source.pictures[-1][0] == number
        states = source.states
        pictures.acknowledge("page", number)
        await next_picture(source)
        assert source.pictures[-1] == (number + 1, states + 1)

    run(scenario)


def test_picture_is_a_jpeg_with_its_number():
    async def scenario(pictures, source, beats, pushed):
        pictures.acknowledge("page", 0)
        await next_picture(source)
        assert [meta["number"] for _, meta in pushed] == [n for n, _ in source.pictures]
        assert {content for content, _ in pushed} == {b"\xff\xd8"}

    run(scenario)


def test_error_ends_the_render_loop():
    class Broken(Source):
        def prepare(self):
            raise ValueError("no scene")

    async def scenario():
        await RenderLoop(Area(), Broken(), lambda number: None).run()

    with pytest.raises(ValueError, match="no scene"):
        asyncio.run(scenario())
