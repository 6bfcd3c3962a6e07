"""Names of frames: tf's lower_snake inside, the SlicerIGT and IGSIO names at the edges.

``StylusTipToStylus`` (IGSIO, MRML) is the transform whose source is ``stylus_tip`` and whose
target is ``stylus``; in tf terms its parent is ``stylus`` and its child ``stylus_tip``.
"""

import re
from functools import lru_cache

from app.geometry.errors import FrameError

_FRAME = re.compile(r"[A-Za-z0-9_.-]+(?:/[A-Za-z0-9_.-]+)*")
# A new word starts before a capital that follows a small letter or a digit ("StylusTip"), and
# before the last capital of an acronym that is followed by a small letter ("RASTip").
_WORD_STARTS = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
_TO = re.compile(r"(?<=[A-Za-z0-9])To(?=[A-Z0-9])")


def check_frame(name: str) -> str:
    """Return ``name`` when it can be a tf frame; raise `FrameError` otherwise."""
    if not isinstance(name, str) or not _is_frame(name):
        raise FrameError(
            f"frame name {name!r} is not allowed: letters, digits, '_', '-' and '.', "
            "parts joined by '/', none empty, no leading '/'"
        )
    return name


@lru_cache(maxsize=4096)  # a session has few frames, and names them in every transform
def _is_frame(name: str) -> bool:
    return _FRAME.fullmatch(name) is not None


def snake_case(name: str) -> str:
    """``StylusTip`` to ``stylus_tip``, ``RAS`` to ``ras``."""
    return check_frame(_WORD_STARTS.sub("_", name).lower())


def camel_case(frame: str) -> str:
    """``stylus_tip`` to ``StylusTip``, ``ras`` to ``Ras``: the name that MRML nodes carry."""
    return "".join(word[:1].upper() + word[1:] for word in check_frame(frame).split("_"))


def split_transform_name(name: str) -> tuple[str, str] | None:
    """``StylusTipToStylus`` to ``("stylus_tip", "stylus")``: source, then target.

    Returns None for a name without ``To`` between two words. A name that can be split in more
    than one place raises `FrameError`, because guessing would swap frames silently.
    """
    places = [match.span() for match in _TO.finditer(name)]
    if not places:
        return None
    if len(places) > 1:
        raise FrameError(f"transform name {name!r} can be split at 'To' in {len(places)} places")
    start, end = places[0]
    return snake_case(name[:start]), snake_case(name[end:])


def join_transform_name(source: str, target: str) -> str:
    """``("stylus_tip", "stylus")`` to ``StylusTipToStylus``, the MRML and IGSIO name."""
    return f"{camel_case(source)}To{camel_case(target)}"
