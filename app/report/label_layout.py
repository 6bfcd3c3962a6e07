"""Places of labels in a column, so that none lies over another."""

from collections.abc import Sequence


def spread(places: Sequence[float], step: float, top: float) -> list[float]:
    """``places`` moved up as far as they must be to be ``step`` apart, in their order.

    Places are those of the labels' lower edges and grow downwards. The lowest keeps its place,
    unless the highest would come above ``top``: then all that are too near to it move down.

    >>> spread([50.0, 100.0, 97.0], 10.0, 0.0)
    [50.0, 100.0, 90.0]
    >>> spread([1.0, 2.0], 10.0, 5.0)
    [5.0, 15.0]
    """
    moved = list(places)
    order = sorted(range(len(places)), key=lambda index: places[index])
    limit = float("inf")
    for index in reversed(order):
        moved[index] = min(places[index], limit)
        limit = moved[index] - step
    limit = top
    for index in order:
        moved[index] = max(moved[index], limit)
        limit = moved[index] + step
    return moved
