"""Numbers as text, of the form that every program reads alike."""


def is_plain(text: str) -> bool:
    """Whether ``text`` has no 1_0, which Python would read as ten, and no other script's digits."""
    return text.isascii() and "_" not in text
