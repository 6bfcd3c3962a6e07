"""Numbers of text files, in plain decimal form, which every program reads alike."""

from app.geometry import InputError, is_plain_number


def parse_numbers(text: str, count: int, place: str) -> list[float]:
    """Parse ``count`` numbers separated by white space.

    NaN and infinities are accepted; the caller decides about them. Raises `InputError`, with
    ``place``, for another count and for a word that is not a plain decimal number.
    """
    words = text.split()
    if len(words) != count:
        raise InputError(f"{place} has {len(words)} numbers; expected {count}")
    if is_plain_number(text):
        try:
            return [float(word) for word in words]
        except ValueError:
            pass  # reported below with the word
    raise InputError(f"{place}: {next(filter(_is_invalid, words))!r} is not a number")


def _is_invalid(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return True
    return not is_plain_number(word)
