from pathlib import Path

import pytest

from app.files.document import Section
from app.files.yaml_file import MAX_BYTES
from app.geometry import InputError


def load(tmp_path: Path, text: str, allowed: tuple[str, ...] = ("a", "b")) -> Section:
    path = tmp_path / "x.yaml"
    path.write_text(text)
    return Section.load(path, allowed)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\na: 2\n", "duplicate key 'a'"),
        ("a: {b: 1, b: 2}\n", "duplicate key 'b'"),
        ("a: &x {c: 1}\nb: {<<: *x}\n", "merge key"),
        ("a: &x [*x]\nc: *x\n", "c is unknown"),
        ("a: " + "[" * 40 + "]" * 40, "nested deeper"),
        ("a: " + "[" * 20000, "nested deeper"),
        ("a: !!python/object/apply:os.getcwd []\n", "could not determine a constructor"),
        ("? [1, 2]\n: 3\n", "expected a scalar"),
        ("- 1\n", "expected a mapping"),
        ("", "expected a mapping"),
        ("a: [1\n", "line 2"),
        ("a: 2026-99-99\n", "not YAML"),
        ("c: 1\n", "x.yaml: c is unknown; expected one of a, b"),
        ("a: '" + "x" * MAX_BYTES + "'", "more than"),
    ],
)
def test_malformed_document_is_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        load(tmp_path, text)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_nested_aliases_are_not_expanded(tmp_path: Path) -> None:
    lines = ["a:", "  - &x0 [boom, boom, boom, boom, boom, boom, boom, boom, boom, boom]"]
    lines += [f"  - &x{n + 1} [{', '.join([f'*x{n}'] * 10)}]" for n in range(30)]
    section = load(tmp_path, "\n".join([*lines, "b: *x30"]))
    with pytest.raises(InputError, match=r"b is \[\[") as caught:
        section.text("b")
    assert len(str(caught.value)) < 200


def test_alias_of_a_value_is_accepted(tmp_path: Path) -> None:
    section = load(tmp_path, "a: &x [1.0, 2.0]\nb: *x\n")
    assert section.numbers("a", 2) == section.numbers("b", 2) == (1.0, 2.0)


def test_bytes_that_are_not_utf8_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_bytes(b"a: \xff\xfe")
    with pytest.raises(InputError, match="not UTF-8"):
        Section.load(path, ("a",))


@pytest.mark.parametrize(
    "value", ["'1'", "true", ".nan", ".inf", "[1]", "1e3", "null", "1" + "0" * 400]
)
def test_value_that_is_not_a_finite_number_is_refused(tmp_path: Path, value: str) -> None:
    with pytest.raises(InputError, match=r"x\.yaml: a is .*expected a (finite )?number"):
        load(tmp_path, f"a: {value}\n").number("a")


@pytest.mark.parametrize("value", ["010", "1_0", "0x10", "1:30", "1:30.5", "0b1", "-010", "1_0.5"])
def test_ambiguous_number_is_refused(tmp_path: Path, value: str) -> None:
    """YAML 1.1 reads them as 8, 10, 16, 90 and so on; YAML 1.2 does not."""
    with pytest.raises(
        InputError, match=rf"x\.yaml line 1: '{value}' is an ambiguous number; use plain"
    ):
        load(tmp_path, f"a: {value}\n")
    assert load(tmp_path, f"a: '{value}'\n").text("a") == value


def test_error_names_the_place_of_a_nested_value(tmp_path: Path) -> None:
    section = load(tmp_path, "a: {b: [{a: 1}, {c: 2}]}\n").section("a", ("b",))
    with pytest.raises(InputError, match=r"x\.yaml: a\.b\[1\]\.c is unknown; expected one of a"):
        section.sections("b", ("a",))


def test_values_of_the_right_type_are_returned(tmp_path: Path) -> None:
    section = load(tmp_path, "a: [1, 2.5, -3.0e+2]\nb: {a: 3, b: word}\n")
    assert section.numbers("a", 3) == (1.0, 2.5, -300.0)
    inner = section.section("b", ("a", "b"))
    assert (inner.integer("a", minimum=0), inner.text("b")) == (3, "word")
