from pathlib import Path

import pytest

from app.files.document import Section
from app.files.keys import Block, Integer, Key, ListOf, Number, Numbers, Text
from app.files.yaml_file import MAX_BYTES
from app.geometry import InputError
from tests.refusals import refused

TEXT = Text("a text")
NUMBER = Number("a number")


def load(tmp_path: Path, text: str, a: Key = TEXT, b: Key = TEXT) -> Section:
    path = tmp_path / "x.yaml"
    path.write_text(text)
    return Section.load(path, Block("a document", {"a": a, "b": b}))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\na: 2\n", "duplicate key 'a'"),
        ("a: {b: 1, b: 2}\n", "duplicate key 'b'"),
        ("a: &x {c: 1}\nb: {<<: *x}\n", "merge key"),
        ("a: &x [*x]\nb: *x\n", "line 1: the alias 'x' contains itself"),
        ("a: " + "[" * 40 + "]" * 40, "nested deeper"),
        ("a: " + "[" * 20000, "nested deeper"),
        (
            "a: !!python/object/apply:os.getcwd []\n",
            "line 1: the tag 'tag:yaml.org,2002:python/object/apply:os.getcwd' is",
        ),
        ("? [1, 2]\n: 3\n", "expected a scalar"),
        ("- 1\n", "expected a mapping"),
        ("", "expected a mapping"),
        ("a: [1\n", "line 2"),
        ("a: !!timestamp 1\n", "the tag 'tag:yaml.org,2002:timestamp' is not allowed"),
        ("c: 1\n", "x.yaml: c is unknown; expected one of a, b"),
        ("a: '" + "x" * MAX_BYTES + "'", "more than"),
    ],
)
def test_malformed_document_is_refused_in_one_line(tmp_path, text, message):
    with refused(text=message):
        load(tmp_path, text)


def test_document_that_is_large_with_its_aliases_written_out_is_refused(tmp_path):
    lines = ["a:", "  - &x0 [boom, boom, boom, boom, boom, boom, boom, boom, boom, boom]"]
    lines += [f"  - &x{n + 1} [{', '.join([f'*x{n}'] * 10)}]" for n in range(30)]
    with pytest.raises(InputError, match="line 6: more than 50000 values"):
        load(tmp_path, "\n".join([*lines, "b: *x30"]))


def test_date_is_a_text_and_an_alias_of_a_value_is_accepted(tmp_path):
    assert load(tmp_path, "a: 2026-99-99\nb: 2026-01-01\n").text("a") == "2026-99-99"
    pair = Numbers("two numbers", 2)
    section = load(tmp_path, "a: &x [1.0, 2.0]\nb: *x\n", pair, pair)
    assert section.numbers("a") == section.numbers("b") == (1.0, 2.0)


def test_bytes_that_are_not_utf8_are_refused(tmp_path):
    path = tmp_path / "x.yaml"
    path.write_bytes(b"a: \xff\xfe")
    with pytest.raises(InputError, match="not UTF-8"):
        Section.load(path, Block("a document", {"a": TEXT}))


@pytest.mark.parametrize(
    "value", ["'1'", "true", ".nan", ".inf", "[1]", "1e3", "null", "1" + "0" * 400]
)
def test_value_that_is_not_a_finite_number_is_refused(tmp_path, value):
    with pytest.raises(InputError, match=r"x\.yaml: a is .*expected a (finite )?number"):
        load(tmp_path, f"a: {value}\n", NUMBER).number("a")


@pytest.mark.parametrize("value", ["010", "1_0", "0x10", "1:30", "1:30.5", "0b1", "-010", "1_0.5"])
def test_ambiguous_number_is_refused(tmp_path, value):
    """YAML 1.1 reads them as 8, 10, 16, 90 and so on; YAML 1.2 does not."""
    with pytest.raises(
        InputError, match=rf"x\.yaml line 1: '{value}' is an ambiguous number; use plain"
    ):
        load(tmp_path, f"a: {value}\n")
    assert load(tmp_path, f"a: '{value}'\n").text("a") == value


def test_error_names_the_place_of_a_nested_value(tmp_path):
    inner = Block("inner", {"b": ListOf("a list", Block("an item", {"a": TEXT}))})
    section = load(tmp_path, "a: {b: [{a: 1}, {c: 2}]}\n", inner).section("a")
    with pytest.raises(InputError, match=r"x\.yaml: a\.b\[1\]\.c is unknown; expected one of a$"):
        section.sections("b")


def test_values_of_the_right_type_are_returned(tmp_path):
    inner = Block("inner", {"a": Integer("an integer", 0), "b": TEXT})
    section = load(
        tmp_path, "a: [1, 2.5, -3.0e+2]\nb: {a: 3, b: word}\n", Numbers("3 numbers", 3), inner
    )
    assert section.numbers("a") == (1.0, 2.5, -300.0)
    assert (section.section("b").integer("a"), section.section("b").text("b")) == (3, "word")


def test_default_is_returned_for_a_missing_key_only(tmp_path):
    three, half = Integer("an integer", 1, default=3), Number("a number", default=0.5)
    section = load(tmp_path, "{}\n", three, half)
    assert (section.integer("a"), section.number("b")) == (3, 0.5)
    with pytest.raises(InputError, match=r"x\.yaml: a is None; expected an integer"):
        load(tmp_path, "a: null\n", three).integer("a")
    with pytest.raises(InputError, match=r"^x\.yaml: a is missing; expected a count$"):
        load(tmp_path, "{}\n", Integer("a count; 1 for one", 1, optional=True)).integer("a")


@pytest.mark.parametrize(
    ("declared", "value", "expected"),
    [
        (Number("n", minimum=0.0), "-1", "at least 0"),
        (Number("n", above=0.0, maximum=9), "0", "more than 0 to 9 mm"),
        (Number("n", above=0.0), "0", "more than 0"),
        (Number("n", minimum=-9, maximum=9), "9.5", "-9 to 9 mm"),
        (Number("n", maximum=9), "10", "at most 9"),
    ],
)
def test_number_out_of_range_is_refused_with_its_unit(tmp_path, declared, value, expected):
    path = tmp_path / "x.yaml"
    path.write_text(f"a_mm: {value}\n")
    with pytest.raises(InputError) as caught:
        Section.load(path, Block("a document", {"a_mm": declared})).number("a_mm")
    assert str(caught.value) == f"x.yaml: a_mm is {value}; expected {expected}"


def test_misspelt_key_is_refused_with_a_suggestion(tmp_path):
    block = Block("a document", {"stop_mm": NUMBER, "warn_mm": NUMBER})
    with pytest.raises(InputError) as caught:
        Section({"stop_m": 1.0}, "x.yaml:", block)
    assert str(caught.value) == (
        "x.yaml: stop_m is unknown; expected one of stop_mm, warn_mm; did you mean 'stop_mm'?"
    )
    with pytest.raises(InputError, match=r"expected one of stop_mm, warn_mm$"):
        Section({"colour": 1.0}, "x.yaml:", block)
    with pytest.raises(InputError, match=r"x\.yaml: 1 is unknown; expected one of"):
        Section({1: 1.0}, "x.yaml:", block)


def test_short_matrix_is_refused_with_its_place_once(tmp_path):
    short = load(tmp_path, "a: [1, 2]\n", Numbers("a matrix", 16))
    expected = r"^x\.yaml: a is 2 values; expected a list of 16 numbers$"
    with pytest.raises(InputError, match=expected):
        short.matrix("a", target="x", source="y")


def test_replaced_key_is_refused_with_what_stands_for_it():
    block = Block("a document", {"arm": NUMBER}, replaced={"tumor": "the pose of the guard"})
    with pytest.raises(
        InputError, match=r"^x\.yaml: tumor is gone; expected the pose of the guard$"
    ):
        Section({"arm": 1.0, "tumor": {}}, "x.yaml:", block)


def test_key_is_read_as_declared(tmp_path):
    with pytest.raises(TypeError, match="a is declared as Number, not Text"):
        load(tmp_path, "a: 1\n", NUMBER).text("a")
    with pytest.raises(KeyError):
        load(tmp_path, "a: 1\n", NUMBER).text("c")
