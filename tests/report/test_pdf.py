"""The PDF of a report, read by pypdf."""

import io
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imsave
from pypdf import PdfReader

from app.case import Activation
from app.report.pdf import PdfLayout, report_pdf
from app.report.summary import summarise

pytestmark = pytest.mark.slow

INPUTS = {"case.yaml": "a" * 64}


def pdf_of(record, scene=None):
    return report_pdf(record, summarise(record), scene, version="9.8.7", inputs_sha256=INPUTS)


def sizes(reader):
    """Width and height of the embedded pictures, in pixels."""
    return {picture.image.size for page in reader.pages for picture in page.images}


def text_of(content):
    return "\n".join(page.extract_text() for page in PdfReader(io.BytesIO(content)).pages)


@pytest.fixture(scope="module")
def record(record_of):
    return record_of([8.0, -1.25, 7.0], notes=("a truncated file",))


@pytest.fixture(scope="module")
def content(record):
    """The PDF of `record`, without a picture."""
    return pdf_of(record)


def test_pdf_has_the_numbers_and_the_digests(record, content):
    text = text_of(content)
    for expected in (
        *("three frames", "not a medical device", "-1.25 mm", "0.020 s", "9.8.7", "a" * 64),
        *("clear", "a truncated file", "Methods"),
    ):
        assert expected in text
    assert PdfReader(io.BytesIO(content)).metadata["/Title"] == "three frames: margin report"
    assert "/CreationDate" not in PdfReader(io.BytesIO(content)).metadata
    assert pdf_of(record) == content


def test_pdf_tells_the_cautery_at_the_entry_of_a_breach(record, content):
    rows = tuple(replace(row, activation=Activation.UNKNOWN) for row in record.rows)
    assert "unknown" not in text_of(content)
    text = text_of(pdf_of(replace(record, rows=rows)))
    assert "cautery" in text and "unknown" in text


def test_a_picture_is_embedded_and_math_signs_in_a_name_are_text(record_of, content):
    record = record_of([8.0, 3.0], case="cost $5 and $6_a")
    png = io.BytesIO()
    imsave(png, np.random.default_rng(1).random((90, 160, 3)), format="png")
    with_scene = pdf_of(record, png.getvalue())
    assert (160, 90) in sizes(PdfReader(io.BytesIO(with_scene)))
    assert (160, 90) not in sizes(PdfReader(io.BytesIO(content)))
    text = text_of(with_scene)
    assert "The tool was never in the tumour." in text
    assert "cost $5 and $6_a" in text


def test_a_long_table_continues_on_the_next_page_with_its_header():
    with PdfLayout("many rows") as pdf:
        pdf.table(("first", "second"), [(f"row {k}", "x" * 90) for k in range(120)], (0.3, 0.7))
    pages = [page.extract_text() for page in PdfReader(io.BytesIO(pdf.content)).pages]
    assert len(pages) > 2
    assert all("first" in page and "second" in page for page in pages)
    found = [line for page in pages for line in page.splitlines() if line.startswith("row ")]
    assert [line.split()[1] for line in found] == [str(k) for k in range(120)]


def test_a_long_text_continues_on_the_next_page_without_a_gap():
    with PdfLayout("words") as pdf:
        pdf.paragraph("word " * 2400)
    pages = [page.extract_text() for page in PdfReader(io.BytesIO(pdf.content)).pages]
    assert sum(page.split().count("word") for page in pages) == 2400
    assert len(pages) > 2
    assert len({page.count("\n") for page in pages[:-1]}) == 1
