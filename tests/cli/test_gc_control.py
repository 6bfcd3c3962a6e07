"""Cycles are not looked for while a command loads, and are found again afterwards."""

import gc
import weakref

import pytest

from app.cli.gc_control import GcPause


class Cycle:
    def __init__(self) -> None:
        self.itself = self


def forgotten() -> "weakref.ref[Cycle]":
    return weakref.ref(Cycle())


def test_what_is_loaded_stays_and_what_comes_later_is_collected() -> None:
    with GcPause() as memory:
        assert not gc.isenabled()
        loaded = forgotten()
        memory.settle()
        assert gc.isenabled()
        later = forgotten()
        gc.collect()
        assert (loaded() is None, later() is None) == (False, True)
    gc.collect()
    assert loaded() is None


def test_blocks_of_frames_are_no_reason_to_search_and_the_old_thresholds_come_back() -> None:
    before = gc.get_threshold()
    searches: list[dict[str, int]] = []
    try:
        with GcPause() as memory:
            memory.settle()
            gc.callbacks.append(lambda phase, info: searches.append(info))
            kept = [[number] for number in range(10 * before[0])]
            gc.callbacks.pop()
            assert (len(kept), searches) == (10 * before[0], [])
    finally:
        assert gc.get_threshold() == before


def test_an_error_while_loading_leaves_the_search_on() -> None:
    with pytest.raises(ValueError, match="no such case"), GcPause():
        raise ValueError("no such case")
    assert gc.isenabled()


def test_a_program_that_has_switched_the_search_off_keeps_it_off() -> None:
    gc.disable()
    try:
        with GcPause() as memory:
            memory.settle()
            assert not gc.isenabled()
        assert not gc.isenabled()
    finally:
        gc.enable()
