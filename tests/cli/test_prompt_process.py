"""A process that has to react switches threads soon and does not collect what it has loaded."""

import gc
import inspect
import os
import sys
import weakref

import pytest

from app.cli.prompt_process import prompt_process


class Cycle:
    def __init__(self) -> None:
        self.itself = self


def unreachable_cycle() -> "weakref.ref[Cycle]":
    return weakref.ref(Cycle())


def test_loaded_objects_are_not_scanned_and_later_ones_are() -> None:
    with prompt_process():
        assert gc.isenabled()
        assert gc.get_freeze_count() > 10_000
        scanned = len(gc.get_objects())
        later = unreachable_cycle()
        gc.collect()
        assert later() is None
    assert gc.get_freeze_count() == 0
    assert scanned < 1000 < len(gc.get_objects())


def test_a_waiting_thread_gets_the_interpreter_ten_times_sooner() -> None:
    before = sys.getswitchinterval()
    with prompt_process():
        assert sys.getswitchinterval() <= before / 10
    assert sys.getswitchinterval() == before


def test_settings_are_restored_after_an_error() -> None:
    before = sys.getswitchinterval()
    with pytest.raises(ValueError, match="no arm"), prompt_process():
        raise ValueError("no arm")
    assert (sys.getswitchinterval(), gc.get_freeze_count()) == (before, 0)


def test_the_caller_of_a_log_message_is_found_without_a_look_at_all_modules(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(inspect, "modulesbyfile", {})
    monkeypatch.setattr(inspect, "_filesbymodname", {})
    looks, realpath = [], os.path.realpath
    monkeypatch.setattr(os.path, "realpath", lambda path: looks.append(path) or realpath(path))

    def looks_of_a_message() -> int:
        looks.clear()
        inspect.getframeinfo(sys._getframe())
        return len(looks)

    with prompt_process():
        assert looks_of_a_message() < 10
    monkeypatch.setattr(inspect, "modulesbyfile", {})
    monkeypatch.setattr(inspect, "_filesbymodname", {})
    assert looks_of_a_message() > 100
