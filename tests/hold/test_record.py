"""A record of a run: what is read back, and what counts as damaged."""

import json
import os
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.hold import StateFileError
from app.hold.record import (
    MAX_BYTES,
    MAX_CAUSE_CHARS,
    MAX_CAUSES,
    HoldRecord,
    InstanceKey,
    RunRecord,
    Slot,
    arm_name,
    as_bytes,
    host_id,
    read_record,
)
from app.runtime import used_values
from tests.session_content import one_link_content

KEY = InstanceKey("host", 7, "/watch", "touch /joint_states")
NAMESPACE, ARM = KEY.slots
USED = used_values(one_link_content())
RUN = RunRecord(KEY, 42, 10**18, 10**18 + 5, ended=False, hold=None, used=USED)
HELD = RunRecord(KEY, 42, 10**18, 10**18, True, HoldRecord(10**18, ("stale", "é 腫")), USED)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "record.json"


@pytest.mark.parametrize("record", [RUN, HELD])
@pytest.mark.parametrize("slot", [NAMESPACE, ARM])
def test_record_is_read_as_it_was_written(path, record, slot):
    path.write_bytes(as_bytes(record))
    assert read_record(path, slot) == record


def test_no_file_is_no_record(path):
    assert read_record(path, NAMESPACE) is None


def test_only_an_orderly_end_without_hold_allows_a_start():
    assert not RUN.allows_start
    assert not HELD.allows_start
    assert RunRecord(KEY, 42, 0, 0, ended=True, hold=None, used=USED).allows_start


@given(position=st.integers(0), byte=st.integers(1, 255))
def test_any_changed_byte_is_the_same_record_or_an_error(tmp_path_factory, position, byte):
    path = tmp_path_factory.getbasetemp() / "changed.json"
    content = bytearray(as_bytes(RUN))
    content[position % len(content)] ^= byte
    path.write_bytes(content)
    with suppress(StateFileError):
        assert read_record(path, NAMESPACE) == RUN  # white space was changed


def test_every_truncation_is_an_error(path):
    content = as_bytes(RUN).rstrip()
    for length in range(len(content)):
        path.write_bytes(content[:length])
        with pytest.raises(StateFileError):
            read_record(path, NAMESPACE)


@given(st.binary(max_size=300))
def test_random_bytes_are_an_error(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "random.json"
    path.write_bytes(content)
    with pytest.raises(StateFileError):
        read_record(path, NAMESPACE)


@pytest.mark.parametrize(
    "content",
    [b"", b"null", b"[]", b"{}", b'{"version": 1}', b"[" * MAX_BYTES, b" " * (MAX_BYTES + 1)],
)
def test_other_json_is_an_error(path, content):
    path.write_bytes(content)
    with pytest.raises(StateFileError):
        read_record(path, NAMESPACE)


@pytest.mark.parametrize(("version", "age"), [(1, "an older"), (3, "a newer")])
def test_other_version_is_an_error_that_says_so(path, version, age):
    path.write_text(json.dumps({**json.loads(as_bytes(RUN)), "version": version}))
    with pytest.raises(StateFileError, match=f"version {version}, of {age} program; expected 2"):
        read_record(path, NAMESPACE)


def test_folder_and_dangling_link_are_errors(path, tmp_path):
    path.mkdir()
    with pytest.raises(StateFileError, match="cannot be read"):
        read_record(path, NAMESPACE)
    link = tmp_path / "link.json"
    link.symlink_to(tmp_path / "nothing")
    with pytest.raises(StateFileError, match="cannot be read"):
        read_record(link, NAMESPACE)


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads every file")
def test_unreadable_file_is_an_error(path):
    path.write_bytes(as_bytes(RUN))
    path.chmod(0)
    with pytest.raises(StateFileError, match="cannot be read"):
        read_record(path, NAMESPACE)


def test_record_of_another_session_is_an_error(path):
    path.write_bytes(as_bytes(RUN))
    with pytest.raises(StateFileError, match="another session; expected namespace '/other'"):
        read_record(path, Slot("host", 7, "namespace", "/other"))


def test_causes_are_bounded(path):
    many = HoldRecord(0, ("x" * 100_000,) * 1000)
    path.write_bytes(as_bytes(RunRecord(KEY, 1, 0, 0, ended=False, hold=many, used=USED)))
    record = read_record(path, NAMESPACE)
    assert record.hold.causes == ("x" * MAX_CAUSE_CHARS,) * MAX_CAUSES


def test_session_without_arm_has_only_its_namespace():
    assert InstanceKey("host", 7, "/", "").slots == (Slot("host", 7, "namespace", "/"),)


@given(st.lists(st.tuples(st.integers(0, 232), st.text(), st.text()), min_size=2, max_size=2))
def test_different_sessions_have_different_file_names(keys):
    stems = [
        {slot.stem for slot in InstanceKey("host", *key[:1], f"/{key[1]}", key[2]).slots}
        for key in keys
    ]
    same = [
        keys[0][0] == keys[1][0] and (keys[0][1] == keys[1][1] or keys[0][2] == keys[1][2] != "")
    ]
    assert bool(stems[0] & stems[1]) is same[0]
    assert all("/" not in stem and stem.isascii() for each in stems for stem in each)


def test_arms_of_one_model_differ_by_the_topic_of_their_joints():
    assert arm_name("psm", "/PSM1/measured_js") != arm_name("psm", "/PSM2/measured_js")
    assert arm_name("touch", None) == "touch"


def test_host_is_its_machine_id_or_its_name(tmp_path):
    machine = tmp_path / "machine-id"
    machine.write_text("a" * 32)
    assert host_id(machine) == host_id(machine)
    assert host_id(machine) != host_id(tmp_path / "none")
    assert "a" * 32 not in host_id(machine)
