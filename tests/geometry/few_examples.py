"""Properties of cheap functions, tested with fewer examples than hypothesis takes by default."""

from collections.abc import Callable
from typing import Any

from hypothesis import given as given_all
from hypothesis import settings


def given(*strategies: Any, **named: Any) -> Callable[[Callable[..., None]], Any]:
    return lambda test: settings(max_examples=20)(given_all(*strategies, **named)(test))
