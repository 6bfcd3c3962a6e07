"""Check of numbers given as text."""


def is_plain_number(text: str) -> bool:
    """True if ``text`` has ASCII characters only and no ``_``.

    Python would read ``1_0`` as ten and accepts digits of other scripts; other programs do not.
    """
    return text.isascii() and "_" not in text
