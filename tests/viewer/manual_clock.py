"""A clock that a test sets."""


class ManualClock:
    """Test double of a steady clock."""

    def __init__(self) -> None:
        self.ns = 0

    def __call__(self) -> int:
        return self.ns
