from .cases import CohortCase, SyntheticCase
from .design import OPTION_RANGES, Design
from .manifest import MANIFEST_FILE, Cohort, open_manifest, write_manifest
from .manifest_keys import COHORT, cohort_schema_text

__all__ = [
    "COHORT",
    "MANIFEST_FILE",
    "OPTION_RANGES",
    "Cohort",
    "CohortCase",
    "Design",
    "SyntheticCase",
    "cohort_schema_text",
    "open_manifest",
    "write_manifest",
]
