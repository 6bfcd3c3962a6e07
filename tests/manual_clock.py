"""A clock that a test sets."""


class ManualClock:
    """Test double of a clock in ns."""

    def __init__(self, ns: int = 0) -> None:
        self.ns = ns

    def __call__(self) -> int:
        return self.ns
