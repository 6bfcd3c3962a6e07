"""The page of a cohort: comparison, outliers linked to their cases, failures, escaping."""

from html.parser import HTMLParser
from io import BytesIO

import matplotlib.image
import numpy as np

from app.cohort import CohortCase, compare, find_outliers, identity_of
from app.cohort.columns import FAILED, OK
from app.report.cohort_html import cohort_html, forest_png, p_text

HOSTILE = "<script>alert(1)</script>"


def rows():
    random = np.random.default_rng(0)
    made = []
    for index in range(40):
        group, source = ("off", "on")[index % 2], f"/cases/{index}"
        case = CohortCase(f"case_{index:02d}", source, group=group, pair=f"p{index // 2}")
        value = 500.0 if index == 6 else float(random.normal(100.0 - 5.0 * (index % 2), 5.0))
        made.append(identity_of(case, "h", "1") | {"status": OK, "path_mm": value, "breaches": 3})
    bad = identity_of(CohortCase(HOSTILE, "javascript:alert(1)"), "", "1")
    return [*made, bad | {"status": FAILED, "reason": f"{HOSTILE} is cut"}]


class Links(HTMLParser):
    def __init__(self):
        super().__init__()
        self.found = {}
        self.scripts = 0

    def handle_starttag(self, tag, attributes):
        self.scripts += tag == "script"
        if tag == "a":
            self.found["last"] = dict(attributes)["href"]

    def handle_data(self, data):
        if "last" in self.found:
            self.found[data] = self.found.pop("last")


def page(given):
    comparisons = compare(given, ("off", "on"))
    plot = forest_png(comparisons)
    return cohort_html("study", given, comparisons, find_outliers(given), plot, "0.1.0"), plot


def test_page_has_comparison_outliers_and_failures():
    text, plot = page(rows())
    assert "<h2>on against off</h2>" in text and "Holm" in text and "data:image/png" in text
    assert plot is not None and matplotlib.image.imread(BytesIO(plot)).shape[1] == 1560
    assert "Outliers (1)" in text and "Cases with an error (1)" in text
    links = Links()
    links.feed(text)
    assert links.found["case_06"] == "file:///cases/6"


def test_values_are_escaped_and_links_are_to_files_and_pages_only():
    text, _ = page(rows())
    links = Links()
    links.feed(text)
    assert links.scripts == 0 and HOSTILE not in text and "&lt;script&gt;" in text
    assert all(link.startswith("file:///") for link in links.found.values())


def test_simulated_case_names_the_command_that_makes_it():
    given = rows()
    given[6] = given[6] | {"source": ""}
    text, _ = page(given)
    assert "make-case --case case_06" in text


def test_cohort_without_groups_has_no_comparison():
    text = cohort_html("study", rows(), (), (), None, "0.1.0")
    assert "No comparison" in text and "<img" not in text


def test_page_says_what_was_measured():
    assert "Measured: the whole mesh of the tool." in page(rows())[0]
    tips = [row | {"tip_only": True} for row in rows()]
    assert "Measured: the tip alone (--tip-only)." in page(tips)[0]


def test_small_p_values_are_bounds():
    assert (p_text(None), p_text(1e-9), p_text(0.0421)) == ("not defined", "below 0.0001", "0.0421")
