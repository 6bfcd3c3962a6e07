"""A document is accepted by its reader if and only if its JSON Schema accepts it.

The exceptions are the rules that a schema cannot state: `tests.schema_agreement.UNSTATED`. More
documents are compared in `tests/case/test_many_examples.py`.
"""

import jsonschema
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from app.case import DOCUMENTS
from tests.schema_agreement import difference, disagreement, refusal, validator
from tests.schema_documents import documents, faulty, settled
from tests.valid_documents import VALID, shipped

pytestmark = pytest.mark.slow


def check_valid_document(document: str, data: st.DataObject) -> None:
    """Except for the rules that a schema cannot state, which half of the examples obey."""
    values = data.draw(documents(validator(document).schema))
    if document != "expected" and data.draw(st.booleans()):
        values = settled(values)
    assume(validator(document).is_valid(values))
    assert disagreement(document, values) is None


def check_edited_document(document: str, data: st.DataObject) -> None:
    values = data.draw(faulty([values for name, values in VALID if name == document]))
    assert disagreement(document, values) is None


@pytest.mark.parametrize("document", DOCUMENTS)
@settings(max_examples=4)
@given(data=st.data())
def test_reader_accepts_what_the_schema_accepts(document, data):
    check_valid_document(document, data)


@pytest.mark.parametrize("document", DOCUMENTS)
@settings(max_examples=30)
@given(data=st.data())
def test_reader_and_schema_agree_on_edited_documents(document, data):
    check_edited_document(document, data)


def test_comparison_finds_a_schema_that_is_too_strict_or_too_lax():
    values = shipped("case")
    strict = jsonschema.Draft202012Validator({"required": ["colour"]})
    lax = jsonschema.Draft202012Validator({})
    refused = refusal("case", values | {"colour": 1})
    assert "the reader accepts" in str(difference(refusal("case", values), strict, values))
    assert "the schema accepts" in str(difference(refused, lax, values))
    assert difference(refused, strict, values) is None
