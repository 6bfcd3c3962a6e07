"""When pictures are drawn: one in flight, the newest state, none without clients; at which rate."""

import asyncio

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.viewer.drawing.render_loop import ClientAcks, FrameRate, RenderLoop

pytestmark = pytest.mark.slow


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
            await asyncio.wait_for(scenario(pictures, source, beats, pushed), 120.0)
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


MS = 1_000_000


@given(st.lists(st.integers(0, 2_000 * MS), min_size=1))
def test_drawing_takes_no_more_than_its_share_of_the_time(costs):
    rate = FrameRate()
    for cost in costs:
        rate.record(cost)
        assert 500 * MS >= rate.period_ns >= 33 * MS
        assert rate.period_ns == 500 * MS or cost <= 0.85 * rate.period_ns + 1


def test_slow_picture_counts_at_once_and_fast_ones_gradually():
    rate = FrameRate()
    rate.record(255 * MS)
    assert rate.period_ns == pytest.approx(300 * MS)
    rate.record(25 * MS)
    assert 200 * MS < rate.period_ns < 300 * MS
    for _ in range(40):
        rate.record(42.5 * MS)
    assert rate.period_ns == pytest.approx(50 * MS, rel=0.01)


S = 1_000_000_000


def test_without_clients_nothing_is_pending():
    acks = ClientAcks()
    acks.sent(1, 0)
    assert not acks.any_active(0)
    assert not acks.is_pending(0)


def test_picture_is_pending_until_a_client_acknowledges_it():
    acks = ClientAcks()
    acks.acknowledge("a", 0, 0)
    acks.acknowledge("b", 0, 0)
    acks.sent(1, 0)
    assert acks.is_pending(1)
    assert acks.is_pending(3)
    acks.acknowledge("b", 1, 4)
    assert not acks.is_pending(5)


def test_client_silent_for_a_second_is_not_waited_for():
    acks = ClientAcks()
    acks.acknowledge("silent", 0, 0)
    acks.sent(1, S // 2)
    assert acks.is_pending(S - 1)
    assert not acks.is_pending(S + 1)
    assert not acks.any_active(S + 1)


def test_lost_picture_is_pending_for_at_most_a_second():
    acks = ClientAcks()
    acks.acknowledge("a", 0, 0)
    acks.sent(1, 0)
    for beat in range(1, 20):
        acks.acknowledge("a", 0, beat * S // 10)
    acks.acknowledge("a", 0, 2 * S)
    assert not acks.is_pending(2 * S)


def test_new_client_has_nothing_pending():
    acks = ClientAcks()
    acks.sent(7, 0)
    acks.acknowledge("new", 0, 1)
    assert acks.any_active(2)
    assert not acks.is_pending(2)
