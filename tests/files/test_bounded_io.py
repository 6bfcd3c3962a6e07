"""Only regular files are read, up to a bound; pointers, hostile XML and numbers are refused."""

import os
import socket
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.files.bounded_io import is_file, is_folder, open_regular, read_bounded
from app.files.meshes import load_mesh
from app.files.numbers import parse_numbers
from app.files.xml_guard import parse_xml, read_xml
from app.geometry import InputError, MeshError
from app.robot import RobotMeshError, UrdfError, load_robot


def test_file_is_read_up_to_its_bound(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    assert read_bounded(path, 5) == b"12345"
    with pytest.raises(MeshError, match=r"/a has more than the 4 bytes allowed"):
        read_bounded(path, 4, MeshError)


def test_pipe_without_writer_and_a_link_to_it_are_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="it is a pipe; expected a regular file"):
        read_bounded(tmp_path / "pipe", 100)
    (tmp_path / "link").symlink_to(tmp_path / "pipe")
    with pytest.raises(InputError, match="it is a pipe"):
        open_regular(tmp_path / "link")


def test_folder_device_and_socket_are_refused(tmp_path):
    with pytest.raises(InputError, match="it is a folder; expected a regular file"):
        open_regular(tmp_path)
    with pytest.raises(InputError, match="it is a device"):
        open_regular(Path("/dev/zero"))
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / "socket"))
        with pytest.raises(InputError, match="cannot be read"):
            open_regular(tmp_path / "socket")


@pytest.mark.parametrize("name", ["a" * 300, "a" * 100_000, "a\0b", "missing", "loop"])
def test_name_of_no_file_is_refused_in_one_line(tmp_path, name):
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    with pytest.raises(InputError, match="cannot be read") as caught:
        read_bounded(tmp_path / name, 100)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 2000
    assert not is_file(tmp_path / name)
    assert not is_folder(tmp_path / name)


def test_no_descriptor_stays_open_after_a_refusal(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    before = len(list(Path("/proc/self/fd").iterdir()))
    for _ in range(5):
        with pytest.raises(InputError):
            open_regular(tmp_path / "pipe")
    assert len(list(Path("/proc/self/fd").iterdir())) == before


POINTER = """version https://git-lfs.github.com/spec/v1
oid sha256:4d7a214614ab2935c943f9e0ff69d22eadbb8f32b1258daaa5e2ca24d17e2393
size 12345
"""


@pytest.mark.parametrize("ending", [".stl", ".obj", ".ply"])
def test_pointer_in_place_of_a_mesh_is_named(tmp_path, ending):
    path = tmp_path / f"a{ending}"
    path.write_text(POINTER)
    with pytest.raises(MeshError, match="pointer of Git LFS to a file that is not here"):
        load_mesh(path, units="mm", frame="tool")


def test_pointer_in_place_of_a_robot_or_its_mesh_is_named(tmp_path):
    (tmp_path / "a.urdf").write_text(POINTER)
    with pytest.raises(UrdfError, match="pointer of Git LFS"):
        load_robot(tmp_path / "a.urdf")
    for ending in (".dae", ".glb", ".gltf", ".stl"):
        (tmp_path / f"m{ending}").write_text(POINTER)
        (tmp_path / "b.urdf").write_text(
            '<robot name="a"><link name="l"><collision><geometry>'
            f'<mesh filename="m{ending}"/></geometry></collision></link></robot>'
        )
        with pytest.raises(RobotMeshError, match="pointer of Git LFS"):
            load_robot(tmp_path / "b.urdf")


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


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (BOMB.encode(), "DOCTYPE"),
        # "<!DOCTYPE r>" in UTF-7: a later parser that knows UTF-7 would see the document type.
        (b'<?xml version="1.0" encoding="utf-7"?>+ADw-!DOCTYPE r+AD4-<robot name="r"></robot>',
         "not well-formed"),
        (b'<robot name="r">\n<link name="a">\n</robot>\n', "line 3"),
        (b'<robot name="r"><xacro:thing/></robot>', "not well-formed"),
        (b"", "not well-formed"),
        (b'<robot name="r">' + b"<a>" * 100_000 + b"</a>" * 100_000 + b"</robot>",
         "elements nested deeper than 200 levels"),
    ],
    ids=["bomb", "hidden document type", "malformed", "unbound prefix", "empty", "deep"],
)  # fmt: skip
def test_hostile_and_malformed_xml_is_refused(tmp_path, content, expected):
    path = tmp_path / "a.urdf"
    path.write_bytes(content)
    assert expected in refusal(path)


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


def test_missing_file_and_folder_are_refused(tmp_path):
    assert "cannot be read" in refusal(tmp_path / "absent.urdf")
    assert "cannot be read" in refusal(tmp_path)


def test_file_above_the_size_limit_is_refused(tmp_path):
    path = tmp_path / "long.xml"
    path.write_text("<a>" + " " * 100 + "</a>")
    assert parse_xml(read_xml(path, UrdfError, max_bytes=107), path, UrdfError).tag == "a"
    with pytest.raises(UrdfError, match="more than the 106 bytes"):
        read_xml(path, UrdfError, max_bytes=106)


@given(st.lists(st.floats(), min_size=1, max_size=16))
def test_numbers_survive_a_round_trip(values):
    text = "  ".join(map(repr, values))
    np.testing.assert_array_equal(parse_numbers(text, len(values), "here"), values)


def test_number_forms_of_trackers_are_accepted():
    assert parse_numbers("-0 1e-005 +2.5\t3.\n", 4, "here") == [0.0, 1e-5, 2.5, 3.0]


@pytest.mark.parametrize("word", ["1_0", "\u0661", "x", "1,5", "0x10", "--1", "1e"])
def test_error_names_the_word_that_is_ambiguous_or_not_a_number(word):
    with pytest.raises(InputError, match=f"^here: '{word}' is not a number$"):
        parse_numbers(f"1 {word} nan", 3, "here")


def test_wrong_count_is_refused():
    with pytest.raises(InputError, match="here has 2 numbers; expected 3"):
        parse_numbers("1 2", 3, "here")
