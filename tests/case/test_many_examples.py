"""Readers compared with oracles on many examples; the suite compares fewer of the same."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.case import DOCUMENTS
from tests.case.messages import test_cdr_reader, test_tf_reader
from tests.case.readers.test_mrml import compare_damaged_bundles
from tests.case.test_schema_agreement import check_edited_document, check_valid_document

pytestmark = pytest.mark.exhaustive


@pytest.mark.parametrize("document", DOCUMENTS)
@settings(max_examples=60)
@given(data=st.data())
def test_reader_accepts_what_the_schema_accepts(document, data):
    check_valid_document(document, data)


@pytest.mark.parametrize("document", DOCUMENTS)
@settings(max_examples=300)
@given(data=st.data())
def test_reader_and_schema_agree_on_edited_documents(document, data):
    check_edited_document(document, data)


@pytest.mark.parametrize(
    "compare",
    [
        test_cdr_reader.compare_messages,
        test_cdr_reader.compare_cut_messages,
        test_cdr_reader.compare_changed_messages,
        test_tf_reader.compare_messages,
        test_tf_reader.compare_changed_messages,
    ],
)
def test_messages_are_read_as_by_the_oracle(compare):
    compare(300)


def test_damaged_bundle_is_refused_or_read_identically(tmp_path):
    compare_damaged_bundles(tmp_path / "x.mrb", 300)
