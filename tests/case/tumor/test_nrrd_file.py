import gzip
from collections.abc import Callable
from contextlib import suppress

import numpy as np
import pytest

from app.case.tumor import read_nrrd
from app.geometry import InputError
from tests.refusals import refused


@pytest.mark.parametrize("encoding", ["raw", "gzip", "bzip2"])
@pytest.mark.parametrize("kind", ["u1", "i2", ">i4", "u8"])
def test_all_encodings_and_types_are_read(write_nrrd, block, encoding, kind):
    path = write_nrrd(block.astype(kind), encoding=encoding)
    volume = read_nrrd(path)
    np.testing.assert_array_equal(volume.layers, block[None])
    assert not volume.layers.flags.writeable


@pytest.mark.parametrize(
    ("space", "signs"),
    [
        ("left-posterior-superior", [-1.0, -1.0, 1.0]),
        ("LPS", [-1.0, -1.0, 1.0]),
        ("right-anterior-superior", [1.0, 1.0, 1.0]),
        ("left-anterior-superior", [-1.0, 1.0, 1.0]),
    ],
)
def test_positions_are_in_ras(write_nrrd, block, space, signs):
    turned = np.array([[0.8, 0.6, 0.0], [-1.2, 1.6, 0.0], [0.0, 0.0, 3.0]])
    volume = read_nrrd(write_nrrd(block, space=space, **{"space directions": turned}))
    # One step along j, by the header of the file.
    expected = np.add([10.0, 20.0, 30.0], [-1.2, 1.6, 0.0]) * signs
    np.testing.assert_allclose(volume.ras_from_index @ [0.0, 1.0, 0.0, 1.0], expected)


@pytest.mark.parametrize("axis", [0, 3])
def test_layers_become_the_first_axis(write_nrrd, block, axis):
    both = np.stack([block, 1 - np.minimum(block, 1)], axis=axis)
    directions = np.insert(np.diag([1.0, 2.0, 3.0]), axis, np.nan, axis=0)
    volume = read_nrrd(write_nrrd(both, **{"space directions": directions}))
    np.testing.assert_array_equal(volume.layers[0], block)
    assert volume.layers.shape == (2, 6, 7, 8)
    np.testing.assert_array_equal(volume.ras_from_index[:, 3], [-10.0, -20.0, 30.0])


def test_texts_of_the_header_are_kept(write_nrrd, block):
    path = write_nrrd(block, Note="Groesse: 3")
    path.write_bytes(path.read_bytes().replace(b"Groesse", "Größe\u2028".encode()))
    assert read_nrrd(path).fields["Note"] == "Größe\u2028: 3"


NAN = np.diag([1.0, 2.0, np.nan])
FLAT = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"space": None}, "the field 'space' is missing"),
        ({"space": "scanner-xyz"},
         "space is 'scanner-xyz'; expected right-anterior-superior, left-ant"),
        ({"space origin": None}, "'space origin' is missing"),
        ({"space origin": np.array([np.nan, 0.0, 0.0])}, "expected finite numbers"),
        ({"space directions": None, "spacings": [1, 1, 1]}, "'space directions' is missing"),
        ({"space directions": NAN}, "expected finite numbers"),
        ({"space directions": FLAT}, "lie in one plane"),
        ({"space directions": np.eye(3) * 0.001},
         "measure 0.001 x 0.001 x 0.001 mm; expected 0.01 to 100"),
        ({"space directions": np.zeros((3, 3))}, "measure 0 x 0 x 0 mm"),
        ({"space directions": np.diag([1.0, 1.0, 101.0])},
         "measure 1 x 1 x 101 mm; expected 0.01 to 100"),
        ({"space units": ["m", "m", "m"]}, "space units are 'm'; expected mm"),
    ],
)  # fmt: skip
def test_invalid_geometry_is_refused(write_nrrd, block, changes, message):
    path = write_nrrd(block, **changes)
    with refused(message) as caught:
        read_nrrd(path)
    assert path.name in str(caught.value)


def test_other_axes_and_types_of_values_are_refused(write_nrrd, block):
    with pytest.raises(InputError, match="0 of its 4 axes are lists; expected one"):
        read_nrrd(write_nrrd(block[None], **{"space directions": np.ones((4, 3))}))
    with pytest.raises(InputError, match=r"dimension is 2 and sizes are \[7, 8\]"):
        read_nrrd(write_nrrd(block[0], **{"space directions": np.eye(3)[:2]}))
    with pytest.raises(InputError, match="type is 'float'; expected integers"):
        read_nrrd(write_nrrd(block.astype(np.float32)))


def replaced(old: bytes, new: bytes) -> Callable[[bytes], bytes]:
    def edit(content: bytes) -> bytes:
        assert old in content
        return content.replace(old, new)

    return edit


def sizes(new: bytes) -> Callable[[bytes], bytes]:
    return replaced(b"sizes: 6 7 8", b"sizes: " + new)


def encoding(new: bytes) -> Callable[[bytes], bytes]:
    return replaced(b"encoding: raw", b"encoding: " + new)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda content: content[:-5], "data (are cut or damaged|do not fit)"),
        (lambda content: content[: content.index(b"\n\n") + 2], "data (are cut|do not fit)"),
        (lambda content: content[:100], "is not an NRRD file"),
        (lambda content: b"", "is not an NRRD file"),
        (lambda content: b"GIF89a" + content, "is not an NRRD file"),
        (sizes(b"6 7 9"), "do not fit its header"),
        (sizes(b"6 7 7"), "295 bytes or more; expected 294"),
        (sizes(b"6 -7 8"), r"sizes are \[6, -7, 8\]"),
        (sizes(b"6 0 8"), r"sizes are \[6, 0, 8\]"),
        (sizes(b"6 7"), r"dimension is 3 and sizes are \[6, 7\]"),
        (sizes(b"60000 70000 80000"), "expected 1 to 134217728 values"),
        (sizes(b"six"), "no readable NRRD header"),
        (replaced(b"dimension: 3", b"dimension: three"), "no readable NRRD header"),
        (replaced(b"NRRD0005", b"NRRD0099"), "no readable NRRD header: Unsupported"),
        (encoding(b"zip"), "encoding is 'zip'; expected raw, gzip or bzip2"),
        (encoding(b"gzip"), "data are cut or damaged"),
        (encoding(b"bzip2"), "data are cut or damaged"),
        (replaced(b"encoding: raw\n", b""), "the field 'encoding' is missing"),
        (replaced(b"type: uint8", b"type: quaternion"), "type is 'quaternion'; expected integers"),
        (replaced(b"encoding", b"data file: ../../etc/passwd\nencoding"),
         "'data file' is '.*same"),
        (replaced(b"encoding", b"datafile: LIST\nencoding"), "'datafile' is 'LIST'"),
        (replaced(b"encoding", b"byte skip: -1\nencoding"), "'byte skip' is '-1'"),
        (replaced(b"space origin: (10", b"space origin: (ten"), "no readable NRRD header"),
    ],
)  # fmt: skip
def test_damaged_files_are_refused(write_nrrd, block, edit, message):
    path = write_nrrd(block, encoding="raw")
    path.write_bytes(edit(path.read_bytes()))
    with refused(message):
        read_nrrd(path)


@pytest.mark.parametrize("kind", ["gzip", "bzip2"])
def test_cut_compressed_data_are_refused(write_nrrd, block, kind):
    path = write_nrrd(block, encoding=kind)
    path.write_bytes(path.read_bytes()[:-12])
    with pytest.raises(InputError, match=r"data (are cut or damaged|do not fit)"):
        read_nrrd(path)


def test_compressed_data_are_not_unpacked_beyond_their_size(write_nrrd, monkeypatch):
    path = write_nrrd(np.zeros((200, 200, 200), dtype=np.uint8))
    path.write_bytes(path.read_bytes().replace(b"sizes: 200 200 200", b"sizes: 2 2 2"))
    taken = []
    read = gzip.GzipFile.read

    def watched(file: gzip.GzipFile, size: int | None = -1) -> bytes:
        data = read(file, size)
        taken.append(len(data))
        return data

    monkeypatch.setattr(gzip.GzipFile, "read", watched)
    with pytest.raises(InputError, match="9 bytes or more; expected 8"):
        read_nrrd(path)
    assert taken == [9]


@pytest.mark.parametrize("size", [b"inf 2 2", b"nan 2 2", b"1e300 2 2", b"9" * 4307 + b" 2 2"])
def test_sizes_that_are_no_integers_are_refused(write_nrrd, block, size):
    path = write_nrrd(block, encoding="raw")
    path.write_bytes(sizes(size)(path.read_bytes()))
    with pytest.raises(InputError, match=r"sizes are|no readable NRRD header"):
        read_nrrd(path)


def test_warnings_of_the_library_are_silent(write_nrrd, block, recwarn):
    path = write_nrrd(block, encoding="raw")
    path.write_bytes(encoding(b"raw\nencoding: raw")(path.read_bytes()))
    with suppress(InputError):
        read_nrrd(path)
    assert not recwarn.list


def test_missing_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_nrrd(tmp_path / "no.nrrd")
