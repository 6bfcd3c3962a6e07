"""Frame names: lower_snake as in tf, converted to and from SlicerIGT and IGSIO names.

``StylusTipToStylus`` (IGSIO, MRML) is the transform whose source is ``stylus_tip`` and whose
target is ``stylus``; in tf terms its parent is ``stylus`` and its child ``stylus_tip``.
"""

import re
from functools import lru_cache

from app.geometry.errors import FrameError

MAX_FRAME_CHARS = 1024
FRAME_NAME = re.compile(r"[A-Za-z0-9_.-]+(?:/[A-Za-z0-9_.-]+)*")
# A word starts at a capital after a lower-case letter or a digit ("StylusTip"), and at the last
# capital of an acronym if a lower-case letter follows ("RASTip").
_WORD_STARTS = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
_TO = re.compile(r"(?<=[A-Za-z0-9])To(?=[A-Z0-9])")


def check_frame(name: str) -> str:
    """Return ``name`` if it is a valid tf frame name; raise `FrameError` otherwise."""
    if not isinstance(name, str) or len(name) > MAX_FRAME_CHARS or not is_frame(name):
        raise FrameError(
            f"frame name {name!r} is not allowed; expected letters, digits, '_', '-' and '.', in "
            f"non-empty parts joined by '/', without a leading '/', {MAX_FRAME_CHARS} or fewer"
        )
    return name


@lru_cache(maxsize=4096)  # the few frames of a session are checked with every transform
def is_frame(name: str) -> bool:
    """True if tf allows the characters of ``name``."""
    return FRAME_NAME.fullmatch(name) is not None


def snake_case(name: str) -> str:
    """``StylusTip`` to ``stylus_tip``, ``RAS`` to ``ras``. Raises `FrameError`."""
    return check_frame(_WORD_STARTS.sub("_", name).lower())


def camel_case(frame: str) -> str:
    """``stylus_tip`` to ``StylusTip``, ``ras`` to ``Ras``, as in names of MRML nodes."""
    return "".join(word[:1].upper() + word[1:] for word in check_frame(frame).split("_"))


def split_transform_name(name: str) -> tuple[str, str] | None:
    """``StylusTipToStylus`` to ``("stylus_tip", "stylus")``: source, then target.

    Returns None for a name without ``To`` between two words. Raises `FrameError` for a name with
    more than one possible split: a wrong guess would silently swap frames.
    """
    spans = [match.span() for match in _TO.finditer(name)]
    if not spans:
        return None
    if len(spans) > 1:
        raise FrameError(
            f"transform name {name!r} is ambiguous: 'To' occurs in {len(spans)} places; expected 1"
        )
    start, end = spans[0]
    return snake_case(name[:start]), snake_case(name[end:])


def join_transform_name(source: str, target: str) -> str:
    """``("stylus_tip", "stylus")`` to ``StylusTipToStylus``, the MRML and IGSIO name."""
    return f"{camel_case(source)}To{camel_case(target)}"
