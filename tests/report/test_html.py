import base64
import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from app.case import Activation, Expected
from app.report import summarise
from app.report.page import NOT_A_DEVICE
from app.report.rows import count_reasons
from app.report.write import report_html

PLOT, SCENE = b"\x89PNG plot", b"\x89PNG scene"
_VOID = {"meta", "img", "br"}


class Page(HTMLParser):
    """Checks that tags nest, and gathers text, attributes and table rows."""

    def __init__(self, page):
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.text = ""
        self.rows: list[list[str]] = []
        self.feed(page)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]
        if tag not in _VOID:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if {"style", "script"} & set(self.open):
            return
        self.text += data
        if self.open[-1:] in (["td"], ["th"]):
            self.rows[-1][-1] += data


def page_of(record, scene=SCENE):
    return report_html(summarise(record), count_reasons(record.rows), PLOT, scene, "1.2.3")


def test_breach_tells_the_state_of_the_cautery_at_its_entry(record_of):
    record = record_of([6.0, -1.0, -2.0, 6.0])
    plain = Page(page_of(record))
    assert "cautery at entry" not in plain.text
    states = [Activation.OFF, Activation.ON, Activation.OFF, Activation.UNKNOWN]
    rows = tuple(
        replace(row, activation=told) for row, told in zip(record.rows, states, strict=True)
    )
    told = record_of([], rows=rows)
    assert summarise(told)["breaches"][0]["cautery_at_entry"] == "on"
    expected = [
        [*row, {"breach": "cautery at entry", "1": "on"}[row[0]]] if len(row) == 9 else row
        for row in plain.rows
    ]
    assert Page(page_of(told)).rows == expected


def test_page_has_no_script_and_no_external_resource(record_of):
    text = page_of(record_of([6.0, -1.0]))
    page = Page(text)
    assert not {"script", "link", "iframe", "object", "base"} & set(page.tags)
    for name, value in page.attributes:
        assert name not in ("href", "srcset", "action") and not name.startswith("on")
        assert name != "src" or value.startswith("data:image/png;base64,")
    assert not re.search(r"https?:|//[a-z]|url\(|@import", text)


def test_pictures_are_embedded(record_of):
    sources = [v for name, v in Page(page_of(record_of([6.0, -1.0]))).attributes if name == "src"]
    assert [base64.b64decode(source.partition(",")[2]) for source in sources] == [PLOT, SCENE]
    sources = [v for n, v in Page(page_of(record_of([6.0]), scene=None)).attributes if n == "src"]
    assert len(sources) == 1


def test_tables_hold_the_numbers(record_of):
    record = record_of([6.0, -1.0, -2.0, None, 6.0], expected=Expected(frames=6))
    page = Page(page_of(record))
    assert [
        *("1", "0.020 s", "0.040 s", "0.020 s", "-2.00 mm"),
        *("-", "-", "-", "in frames"),
    ] in page.rows
    assert ["POSITIVE", "in the tumour", "2", "0.040 s"] in page.rows
    assert ["frames", "fail", "5 frames, 6 expected"] in page.rows
    assert ["stale", "1", "0.060 s"] in page.rows
    assert ["stale_after_ms", "200"] in page.rows
    assert "0 of 1 pass" in page.text


def test_page_states_disclaimer_provenance_and_version(record_of):
    text = Page(page_of(record_of([6.0]))).text
    assert NOT_A_DEVICE in text
    assert "kind: simulated; source: a test" in text
    assert "1.2.3" in text
    assert "never in the tumour" in text


@pytest.mark.parametrize("evil", ["<script>alert(1)</script>", '"><img src=http://x>', "a & b"])
def test_values_are_escaped(record_of, evil):
    record = record_of([6.0], case=evil, provenance={evil: evil}, notes=(evil,))
    page = Page(page_of(record))
    assert "script" not in page.tags
    assert page.tags.count("img") == 2
    assert page.text.count(evil) >= 4  # title, heading, provenance twice, note
