from .columns import failed, finished, identity_of
from .comparison import (
    METRICS,
    Comparison,
    Outlier,
    compare,
    comparison_csv,
    find_outliers,
    groups_of,
)
from .dataset import Dataset
from .design import OPTION_RANGES, CohortCase, Design, SyntheticCase
from .inputs import (
    COHORT,
    MANIFEST_FILE,
    Cohort,
    fetch,
    input_hash,
    is_url,
    open_cohort,
    open_manifest,
    write_manifest,
)

__all__ = [
    "COHORT",
    "MANIFEST_FILE",
    "METRICS",
    "OPTION_RANGES",
    "Cohort",
    "CohortCase",
    "Comparison",
    "Dataset",
    "Design",
    "Outlier",
    "SyntheticCase",
    "compare",
    "comparison_csv",
    "failed",
    "fetch",
    "find_outliers",
    "finished",
    "groups_of",
    "identity_of",
    "input_hash",
    "is_url",
    "open_cohort",
    "open_manifest",
    "write_manifest",
]
