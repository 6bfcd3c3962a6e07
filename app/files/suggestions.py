"""Suggestion for a misspelt word, in messages."""

import difflib
from collections.abc import Iterable


def did_you_mean(word: object, known: Iterable[str]) -> str:
    """Text ``; did you mean 'stop_mm'?`` for the most similar known word; empty without one."""
    similar = difflib.get_close_matches(str(word), list(known), n=1)
    return f"; did you mean {similar[0]!r}?" if similar else ""
