"""Refusals: errors of one line."""

import re
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from app.geometry import InputError


@contextmanager
def refused(
    match: str = "", error: type[Exception] = InputError, *, text: str = ""
) -> Iterator[pytest.ExceptionInfo[Exception]]:
    """The block raises ``error`` in one line that has ``match``, or ``text`` literally."""
    with pytest.raises(error, match=match or re.escape(text) or None) as caught:
        yield caught
    assert "\n" not in str(caught.value)
