"""Garbage collection pauses while a command loads, and resumes afterwards."""

import gc
import weakref

import pytest

from app.cli.gc_control import GcPause


class Cycle:
    def __init__(self) -> None:
        self.itself = self


def unreachable_cycle() -> "weakref.ref[Cycle]":
    return weakref.ref(Cycle())


def test_loaded_objects_stay_and_later_ones_are_collected() -> None:
    with GcPause() as memory:
        assert not gc.isenabled()
        loaded = unreachable_cycle()
        memory.settle()
        assert gc.isenabled()
        later = unreachable_cycle()
        gc.collect()
        assert (loaded() is None, later() is None) == (False, True)
    gc.collect()
    assert loaded() is None


def test_blocks_of_frames_trigger_no_collection_and_thresholds_are_restored() -> None:
    before = gc.get_threshold()
    collections: list[dict[str, int]] = []
    try:
        with GcPause() as memory:
            memory.settle()
            gc.callbacks.append(lambda phase, info: collections.append(info))
            objects = [[number] for number in range(10 * before[0])]
            gc.callbacks.pop()
            assert (len(objects), collections) == (10 * before[0], [])
    finally:
        assert gc.get_threshold() == before


def test_error_while_loading_leaves_collection_enabled() -> None:
    with pytest.raises(ValueError, match="no such case"), GcPause():
        raise ValueError("no such case")
    assert gc.isenabled()


def test_disabled_collection_stays_disabled() -> None:
    gc.disable()
    try:
        with GcPause() as memory:
            memory.settle()
            assert not gc.isenabled()
        assert not gc.isenabled()
    finally:
        gc.enable()
