"""Garbage collection pauses while a command loads; a process that has to react does not scan what
it has loaded, and switches threads soon."""

import gc
import inspect
import os
import sys
import weakref
from contextlib import nullcontext

import pytest

from app.cli.process import GcPause, prompt_process

pytestmark = pytest.mark.long


@pytest.fixture(autouse=True)
def unfrozen():
    """The run of the tests freezes what its collection has loaded, and collects seldom."""
    thresholds = gc.get_threshold()
    gc.set_threshold(700, 10, 10)  # CPython's default
    gc.unfreeze()
    yield
    gc.set_threshold(*thresholds)
    gc.collect()
    gc.freeze()


class Cycle:
    def __init__(self):
        self.itself = self


def unreachable_cycle():
    return weakref.ref(Cycle())


def test_loaded_objects_stay_and_later_ones_are_collected():
    with GcPause() as memory:
        assert not gc.isenabled()
        loaded = unreachable_cycle()
        memory.settle()
        assert gc.isenabled()
        later = unreachable_cycle()
        gc.collect()
        assert (loaded() is None, later() is None) == (False, True)


def test_blocks_of_frames_trigger_no_collection_and_thresholds_are_restored():
    before = gc.get_threshold()
    collections = []
    try:
        with GcPause() as memory:
            memory.settle()
            gc.callbacks.append(lambda phase, info: collections.append(info))
            objects = [[number] for number in range(10 * before[0])]
            gc.callbacks.pop()
            assert (len(objects), collections) == (10 * before[0], [])
    finally:
        assert gc.get_threshold() == before


def test_error_while_loading_leaves_collection_enabled():
    with pytest.raises(ValueError, match="no such case"), GcPause():
        raise ValueError("no such case")
    assert gc.isenabled()


def test_disabled_collection_stays_disabled():
    gc.disable()
    try:
        with GcPause() as memory:
            memory.settle()
            assert not gc.isenabled()
        assert not gc.isenabled()
    finally:
        gc.enable()


def test_loaded_objects_of_a_prompt_process_are_not_scanned_and_later_ones_are():
    with prompt_process():
        assert gc.isenabled()
        assert gc.get_freeze_count() > 10_000
        scanned = len(gc.get_objects())
        later = unreachable_cycle()
        gc.collect()
        assert later() is None
    assert scanned < 1000


@pytest.fixture
def default_s():
    """CPython's default; a session of another test may have shortened it for this process."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(0.005)
    yield 0.005
    sys.setswitchinterval(before)


def test_a_waiting_thread_gets_the_interpreter_ten_times_sooner(default_s):
    with prompt_process():
        assert sys.getswitchinterval() <= default_s / 10
    assert sys.getswitchinterval() == default_s


def test_settings_of_a_prompt_process_are_restored_after_an_error(default_s):
    with pytest.raises(ValueError, match="no arm"), prompt_process():
        raise ValueError("no arm")
    assert sys.getswitchinterval() == default_s


def test_the_caller_of_a_log_message_is_found_without_a_look_at_all_modules(monkeypatch):
    looks, realpath = [], os.path.realpath
    monkeypatch.setattr(os.path, "realpath", lambda path: looks.append(path) or realpath(path))

    def looks_of_a_message(context):
        monkeypatch.setattr(inspect, "modulesbyfile", {})
        monkeypatch.setattr(inspect, "_filesbymodname", {})
        with context:
            looks.clear()
            inspect.getframeinfo(sys._getframe())
            return len(looks)

    assert looks_of_a_message(prompt_process()) < 10
    assert looks_of_a_message(nullcontext()) > 100
