"""Folders, lists and URLs of cases, and the hash of a case's input."""

import functools
import http.server
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from app.cohort import CohortCase, Design, fetch, input_hash, open_cohort
from app.geometry import InputError

pytestmark = pytest.mark.slow


@pytest.fixture
def archive(tmp_path):
    """Four folders that look like cases, two of each group."""
    for name in ("on/b", "on/a", "off/a", "off/c"):
        folder = tmp_path / "archive" / name
        (folder / "sub").mkdir(parents=True)
        (folder / "case.yaml").write_text(name)
        (folder / "sub" / "tracking.mcap").write_bytes(b"x" * 100)
    return tmp_path / "archive"


def names(cohort):
    return [(case.name, case.group) for case in cohort]


EXPECTED = [("off/a", "off"), ("off/c", "off"), ("on/a", "on"), ("on/b", "on")]


def test_folder_is_searched_and_its_first_level_is_the_group(archive):
    assert names(open_cohort(str(archive))) == EXPECTED
    assert names(open_cohort(str(archive / "on"))) == [("a", ""), ("b", "")]
    assert names(open_cohort(str(archive / "on" / "b"))) == [("b", "")]


def test_url_has_the_same_cases_and_files(archive, tmp_path):
    cohort = open_cohort(archive.as_uri())
    assert names(cohort) == EXPECTED
    fetch(cohort.case("on/a").source, tmp_path / "copy")
    assert (tmp_path / "copy" / "case.yaml").read_text() == "on/a"
    assert (tmp_path / "copy" / "sub" / "tracking.mcap").stat().st_size == 100


@contextmanager
def served_by(handler: Callable[..., object]) -> Iterator[str]:
    """The address of an HTTP server."""
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
            thread.join()


def served(folder: Path) -> AbstractContextManager[str]:
    """The address of an HTTP server with an index of ``folder``."""

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *args):
            pass

    return served_by(functools.partial(Quiet, directory=str(folder)))


def test_cases_are_read_over_http(archive, tmp_path):
    with served(archive) as address:
        source = f"{address}/off/a"
        case = CohortCase("a", source)
        assert input_hash(case) == input_hash(case)
        fetch(source, tmp_path / "copy")
    assert (tmp_path / "copy" / "case.yaml").read_text() == "off/a"
    assert (tmp_path / "copy" / "sub" / "tracking.mcap").stat().st_size == 100


def test_names_with_spaces_and_accents_are_the_same_over_http(archive, tmp_path):
    folder = archive / "on" / "Fall 1 (Müller)"
    folder.mkdir()
    (folder / "case.yaml").write_text("on/1")
    (folder / "tumour 50%.stl").write_bytes(b"solid")
    with served(archive) as address:
        cohort = open_cohort(address)
        assert sorted(names(cohort)) == sorted([*EXPECTED, ("on/Fall 1 (Müller)", "on")])
        fetch(cohort.case("on/Fall 1 (Müller)").source, tmp_path / "copy")
    assert (tmp_path / "copy" / "case.yaml").read_text() == "on/1"
    assert (tmp_path / "copy" / "tumour 50%.stl").read_bytes() == b"solid"


def test_an_encoded_path_out_of_the_folder_is_refused(tmp_path):
    class Index(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            body = b'<a href="case.yaml">x</a> <a href="%2e%2e%2fother.yaml">y</a>'
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        do_HEAD = do_GET  # noqa: N815

        def log_message(self, *args):
            pass

    with served_by(Index) as address, pytest.raises(InputError, match="expected files below it"):
        fetch(f"{address}/a", tmp_path / "copy")
    assert not (tmp_path / "other.yaml").exists()


def test_a_server_that_does_not_answer_is_named():
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    with pytest.raises(InputError, match=r"cannot be listed: .*[Cc]onnect"):
        open_cohort(f"http://127.0.0.1:{port}/archive")


def test_list_has_one_source_a_line(archive, tmp_path):
    listed = tmp_path / "list.txt"
    listed.write_text(f"# two cases\n{archive}/on/a\n\narchive/off/c\ns3://bucket/d\n")
    assert [(case.name, case.source) for case in open_cohort(str(listed))] == [
        ("a", f"{archive}/on/a"),
        ("c", f"{tmp_path}/archive/off/c"),
        ("d", "s3://bucket/d"),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("one/a\ntwo/a\n", "two cases have the name 'a': .*one/a and .*two/a"),
        ("# nothing\n", "has no case"),
    ],
)
def test_bad_list_is_one_clear_line(tmp_path, text, message):
    (tmp_path / "list.txt").write_text(text)
    with pytest.raises(InputError, match=message) as error:
        open_cohort(str(tmp_path / "list.txt"))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("unknown://host/x", "cannot be opened"),
        ("file:///no/such/folder", "no files|cannot be listed"),
        ("/no/such/list", "No such file"),
    ],
)
def test_missing_source_is_refused(source, message):
    with pytest.raises(InputError, match=message):
        open_cohort(source)


def test_hash_of_a_folder_is_that_of_names_and_contents(archive):
    case = CohortCase("a", str(archive / "on" / "a"))
    first = input_hash(case)
    assert input_hash(replace(case, group="other")) == first
    (archive / "on" / "a" / "sub" / "tracking.mcap").write_bytes(b"x" * 99 + b"y")
    second = input_hash(case)
    (archive / "on" / "a" / "sub" / "tracking.mcap").rename(archive / "on" / "a" / "moved.mcap")
    assert len({first, second, input_hash(case)}) == 3


def test_hash_of_a_simulated_case_is_that_of_its_options():
    design = Design(4, 1, ranges={"skill": (0.0, 1.0)})
    without, with_fixture, other = (design.case(index) for index in range(3))
    assert input_hash(without) == input_hash(replace(without, name="other", pair=""))
    assert len({input_hash(case) for case in (without, with_fixture, other)}) == 3
