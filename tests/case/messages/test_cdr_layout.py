"""The cache of message layouts and names."""

import struct
import tracemalloc

from app.case.messages.cdr_layout import Known, LayoutReader, Walk

HEAD = b"\0\1\0\0"


def walk_named(walk: Walk) -> Known:
    walk.numbers("I", 4)
    name = walk.text()
    return {walk.fixed(): name}


def named(numbers: tuple[int, bytes], known: Known) -> tuple[str, int]:
    number, stretch = numbers
    return known[stretch], number


def message(number: int, name: str) -> bytes:
    text = name.encode() + b"\0"
    return HEAD + struct.pack("<II", number, len(text)) + text


def test_names_are_decoded_in_any_order_and_repeatedly() -> None:
    read = LayoutReader(walk_named, named)
    # Of one length, of others, with padding to the same length, and each more than once.
    for number, name in enumerate(["arm", "leg", "arm", "needle", "", "leg", "arm"] * 2):
        assert read(message(number, name)) == (name, number)
    assert read(message(1, "ar") + b"\0") == ("ar", 1)
    assert read(message(2, "arm")) == ("arm", 2)


def test_invalid_bytes_give_none_and_leave_the_cache_unchanged() -> None:
    read = LayoutReader(walk_named, named)
    assert read(message(1, "arm")) == ("arm", 1)
    assert read(message(1, "arm")[:-1] + b"m") is None  # no terminating zero
    assert read(HEAD) is None
    assert read(message(1, "arm") + bytes(4)) is None
    assert read(message(3, "arm")) == ("arm", 3)


def test_many_distinct_names_do_not_fill_the_memory() -> None:
    read = LayoutReader(walk_named, named)
    tracemalloc.start()
    try:
        for number in range(3000):
            name = f"{number:05d}" + "x" * (4000 + number % 2)
            assert read(message(number, name)) == (name, number)
        for number in range(100):
            name = "y" * (100_000 + number)
            assert read(message(number, name)) == (name, number)
        held, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert held < 12_000_000  # all of them would be 34 million bytes
