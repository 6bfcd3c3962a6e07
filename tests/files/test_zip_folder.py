"""A zipped case is unpacked under limits, completely or not at all."""

import io
import stat
import zipfile
from collections.abc import Mapping
from pathlib import Path

import pytest

from app.files.zip_folder import MAX_FILES, unpack_folder
from app.geometry import InputError

CASE = {"case.yaml": b"schema: 1\n", "meshes/tumor.stl": b"solid"}


def archive(tmp_path: Path, files: Mapping[str, bytes]) -> Path:
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as made:
        for name, content in files.items():
            made.writestr(name, content)
    return path


def refused(tmp_path: Path, path: Path, match: str, **options: int) -> None:
    with pytest.raises(InputError, match=match):
        unpack_folder(path, tmp_path / "out" / "case", "case.yaml", **options)
    assert not (tmp_path / "out").exists() or list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize("top", ["", "monday/"])
def test_case_at_the_top_or_in_one_folder_is_unpacked(tmp_path, top):
    files = {f"{top}{name}": content for name, content in CASE.items()}
    unpack_folder(archive(tmp_path, files), tmp_path / "case", "case.yaml")
    found = {
        str(path.relative_to(tmp_path / "case")): path.read_bytes()
        for path in (tmp_path / "case").rglob("*")
        if path.is_file()
    }
    assert found == CASE


def test_other_folders_beside_that_of_the_case_are_left_out(tmp_path):
    path = archive(tmp_path, {"day/case.yaml": b"x", "__MACOSX/case.txt": b"y"})
    unpack_folder(path, tmp_path / "case", "case.yaml")
    assert [each.name for each in (tmp_path / "case").iterdir()] == ["case.yaml"]


@pytest.mark.parametrize(
    "name",
    ["../case.yaml", "/etc/x", "a/../../x", "a\\b", "C:x", ".hidden/x", "a/./b", "x" * 201, "a\nb",
     "/".join("abcdefghi")],
)  # fmt: skip
def test_name_that_leaves_the_folder_is_refused(tmp_path, name):
    refused(tmp_path, archive(tmp_path, {**CASE, name: b""}), "has the name .* expected a relative")


def test_link_is_refused(tmp_path):
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w") as made:
        link = zipfile.ZipInfo("case.yaml")
        link.external_attr = (stat.S_IFLNK | 0o777) << 16
        made.writestr(link, "/etc/passwd")
    refused(tmp_path, path, "is a link or a device; expected regular files")


def test_bomb_is_refused_by_what_is_written(tmp_path):
    path = archive(tmp_path, {**CASE, "zeros": bytes(1 << 20)})
    assert path.stat().st_size < 1 << 14
    refused(tmp_path, path, "too large when unpacked", max_bytes=1 << 19)


def test_stated_size_is_not_believed(tmp_path):
    """A header that states fewer bytes than are compressed ends as damage or by the limit."""
    path = archive(tmp_path, {**CASE, "zeros": bytes(1 << 20)})
    data = bytearray(path.read_bytes())
    at = data.rfind(b"PK\x01\x02")
    data[at + 24 : at + 28] = (10).to_bytes(4, "little")
    path.write_bytes(bytes(data))
    refused(tmp_path, path, "damaged|too large", max_bytes=1 << 19)


def test_other_compression_is_refused(tmp_path):
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as made:
        made.writestr("case.yaml", b"x")
    refused(tmp_path, path, "compressed by another method or encrypted")


def test_names_twice_and_too_many_files_are_refused(tmp_path):
    refused(
        tmp_path, archive(tmp_path, {**CASE, "CASE.yaml": b""}), "twice; expected each name once"
    )
    many = {f"{number}": b"" for number in range(MAX_FILES + 1)}
    refused(tmp_path, archive(tmp_path, many), f"expected at most {MAX_FILES}")


@pytest.mark.parametrize("names", [["a/x"], ["a/case.yaml", "b/case.yaml"], ["a/b/case.yaml"]])
def test_archive_without_one_case_is_refused(tmp_path, names):
    path = archive(tmp_path, dict.fromkeys(names, b""))
    refused(tmp_path, path, "folders with a case.yaml; expected one case")


def test_damaged_archive_is_refused(tmp_path):
    whole = archive(tmp_path, {**CASE, "data": bytes(range(256)) * 40}).read_bytes()
    path = tmp_path / "b.zip"
    path.write_bytes(io.BytesIO(whole).read(len(whole) // 2))
    refused(tmp_path, path, "damaged .* expected a zip file")
    damaged = bytearray(whole)
    damaged[whole.index(b"data") + 8] ^= 0xFF
    path.write_bytes(bytes(damaged))
    refused(tmp_path, path, "damaged .* expected a zip file")


def test_existing_folder_is_not_overwritten(tmp_path):
    (tmp_path / "case").mkdir()
    with pytest.raises(InputError, match="already exists; refusing to overwrite it"):
        unpack_folder(archive(tmp_path, CASE), tmp_path / "case", "case.yaml")
    assert list((tmp_path / "case").iterdir()) == []


def test_directory_that_zipfile_would_read_as_a_million_objects_is_refused(tmp_path):
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as opened:
        opened.writestr("case.yaml", b"")
    content = bytearray(made.getvalue())
    at = content.rfind(b"PK\5\6")
    path = tmp_path / "a.zip"
    path.write_bytes(content[: at + 12] + (1 << 28).to_bytes(4, "little") + content[at + 16 :])
    refused(tmp_path, path, f"directory has 268435456 bytes; expected at most {MAX_FILES} files")
    path.write_bytes(content[:at] + b"PK\6\7" + bytes(16) + content[at:])
    refused(tmp_path, path, "in the format zip64; expected")
    path.write_bytes(content[: at + 20])
    refused(tmp_path, path, "no directory at its end")
