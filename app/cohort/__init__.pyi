from .cases import CohortCase, SyntheticCase
from .columns import failed, finished, identity_of
from .dataset import Dataset
from .design import OPTION_RANGES, Design
from .inputs import fetch, input_hash, is_url, open_cohort
from .manifest import MANIFEST_FILE, Cohort, open_manifest, write_manifest
from .manifest_keys import COHORT, cohort_schema_text

__all__ = [
    "COHORT",
    "MANIFEST_FILE",
    "OPTION_RANGES",
    "Cohort",
    "CohortCase",
    "Dataset",
    "Design",
    "SyntheticCase",
    "cohort_schema_text",
    "failed",
    "fetch",
    "finished",
    "identity_of",
    "input_hash",
    "is_url",
    "open_cohort",
    "open_manifest",
    "write_manifest",
]
