"""JSON Schemas of ``case.yaml``, ``live.yaml`` and ``expected.yaml``, for editors."""

import json

from app.case.live_file import LIVE
from app.case.manifest.case_file import CASE
from app.case.manifest.expected import EXPECTED
from app.files.document_text import json_schema

DOCUMENTS = {"case": CASE, "live": LIVE, "expected": EXPECTED}
"""Name of a document -> the declaration of its keys."""


def schema_text(document: str) -> str:
    """Return the JSON Schema of a document of `DOCUMENTS`, as indented JSON."""
    schema = json_schema(DOCUMENTS[document], f"{document}.yaml of MarginGuard, schema 1")
    return json.dumps(schema, indent=2) + "\n"
