"""Hostile and malformed XML is refused in one line, before entities are expanded."""

import pytest

from app.files.xml_guard import parse_xml, read_xml
from app.robot import UrdfError, load_robot

BOMB = (
    '<?xml version="1.0"?>\n<!DOCTYPE robot [\n<!ENTITY a0 "ha">\n'
    + "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">\n' for i in range(1, 12))
    + ']>\n<robot name="&a11;"><link name="a"/></robot>\n'
)


def refusal(path, error=UrdfError):
    with pytest.raises(error) as caught:
        load_robot(path)
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message
    return message


def test_entity_bomb_is_refused(tmp_path):
    path = tmp_path / "bomb.urdf"
    path.write_text(BOMB)
    assert "DOCTYPE" in refusal(path)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "latin-1"])
def test_external_entity_is_refused_in_any_encoding(tmp_path, encoding):
    secret = tmp_path / "secret"
    secret.write_text("xyzzy")
    path = tmp_path / "external.urdf"
    path.write_text(
        f'<?xml version="1.0" encoding="{encoding}"?>\n'
        f'<!DOCTYPE robot [<!ENTITY e SYSTEM "{secret.as_uri()}">]>\n'
        '<robot name="r"><link name="a">&e;</link></robot>',
        encoding=encoding,
    )
    message = refusal(path)
    assert "DOCTYPE" in message
    assert "xyzzy" not in message


def test_encoding_that_hides_a_document_type_is_refused(tmp_path):
    path = tmp_path / "hidden.urdf"
    # "<!DOCTYPE r>" in UTF-7: a later parser that knows UTF-7 would see the document type.
    path.write_bytes(
        b'<?xml version="1.0" encoding="utf-7"?>+ADw-!DOCTYPE r+AD4-<robot name="r"></robot>'
    )
    assert "not well-formed" in refusal(path)


def test_malformed_xml_names_its_line(tmp_path):
    path = tmp_path / "cut.urdf"
    path.write_text('<robot name="r">\n<link name="a">\n</robot>\n')
    assert "line 3" in refusal(path)


def test_unbound_prefix_is_refused(tmp_path):
    path = tmp_path / "prefix.urdf"
    path.write_text('<robot name="r"><xacro:thing/></robot>')
    assert "not well-formed" in refusal(path)


def test_empty_and_missing_files_are_refused(tmp_path):
    empty = tmp_path / "empty.urdf"
    empty.write_bytes(b"")
    assert "not well-formed" in refusal(empty)
    assert "cannot be read" in refusal(tmp_path / "absent.urdf")
    assert "cannot be read" in refusal(tmp_path)


def test_file_above_the_size_limit_is_refused(tmp_path):
    path = tmp_path / "long.xml"
    path.write_text("<a>" + " " * 100 + "</a>")
    assert parse_xml(read_xml(path, UrdfError, max_bytes=107), path, UrdfError).tag == "a"
    with pytest.raises(UrdfError, match="more than the 106 bytes"):
        read_xml(path, UrdfError, max_bytes=106)


def test_deep_nesting_is_refused_without_a_crash(tmp_path):
    path = tmp_path / "deep.urdf"
    path.write_text('<robot name="r">' + "<a>" * 100_000 + "</a>" * 100_000 + "</robot>")
    assert "elements nested deeper than 200 levels" in refusal(path)
