"""Cases with an unusual value within their group."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.cohort.columns import OK, Row
from app.cohort.comparison import METRICS

THRESHOLD = 3.5
_TO_SIGMA = 0.6745


@dataclass(frozen=True, slots=True)
class Outlier:
    """A value whose modified z score (Iglewicz and Hoaglin 1993) is beyond `THRESHOLD`."""

    row: Row
    metric: str
    value: float
    score: float


def find_outliers(rows: Sequence[Row]) -> tuple[Outlier, ...]:
    """Outliers of every metric, within each group, the largest scores first.

    The score is 0.6745 (x - median) / MAD. A metric without spread (MAD 0) has none.
    """
    found = []
    finished = [row for row in rows if row["status"] == OK]
    for group in sorted({str(row["group"]) for row in finished}):
        for metric in METRICS:
            chosen = [
                row for row in finished if row["group"] == group and row.get(metric) is not None
            ]
            values = np.array([float(row[metric] or 0.0) for row in chosen])
            if not len(values):
                continue
            off = values - np.median(values)
            spread = float(np.median(np.abs(off)))
            if spread == 0.0:
                continue
            scores = (_TO_SIGMA * off / spread).tolist()
            found += [
                Outlier(row, metric, float(value), score)
                for row, value, score in zip(chosen, values.tolist(), scores, strict=True)
                if abs(score) > THRESHOLD
            ]
    return tuple(sorted(found, key=lambda each: (-abs(each.score), str(each.row["name"]))))
