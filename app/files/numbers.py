"""Numbers in a text file, of the decimal form that every program reads alike."""

from app.geometry import InputError, is_plain_number


def numbers_in(text: str, count: int, place: str) -> list[float]:
    """The ``count`` numbers of ``text``; `InputError`, with the ``place``, for anything else.

    NaN and infinities are numbers here: what they mean is for the caller to say.
    """
    words = text.split()
    if len(words) != count:
        raise InputError(f"{place} has {len(words)} numbers: {count} wanted")
    if is_plain_number(text):
        try:
            return [float(word) for word in words]
        except ValueError:
            pass  # which word it is, below
    raise InputError(f"{place}: {next(filter(_is_none, words))!r} is not a number")


def _is_none(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return True
    return not is_plain_number(word)
