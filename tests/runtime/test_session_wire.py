"""Contents and commands of a session as text: read back as they were, and nothing else."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.geometry import InputError, MarginGuardError, Transform
from app.runtime import (
    AddNote,
    DescribedSession,
    Rearm,
    Record,
    SessionWire,
    SetRegistration,
    SetTip,
    SetTumor,
    prepare_case,
    prepare_live,
)
from app.runtime.session_wire import VERSION
from tests.runtime.command_world import NEEDLE, STYLUS, STYLUS_TIP
from tests.session.test_step_pickle import assert_same

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def contents(project_root):
    """Contents of a registered case, and of a live session with a needle, a stylus and a robot."""
    case = prepare_case(project_root / "data" / "recorded_case").content
    live = prepare_live(project_root / "data" / "live_example" / "live.yaml").content
    known = STYLUS.with_tip(STYLUS_TIP, 0.3)
    return case, replace(live, items=(NEEDLE, known), tip_sigma_mm=0.25)


def read(written: SessionWire, text: str) -> DescribedSession:
    reader = SessionWire()
    assert reader.missing(text) == set(written.meshes)
    reader.meshes.update(written.meshes)
    return reader.described(text)


def test_description_has_every_number_of_its_content(contents):
    for content in contents:
        writer = SessionWire()
        found = read(writer, writer.description(DescribedSession(content))).content
        assert_same(replace(found, robot=None), replace(content, robot=None))
        for name in ("base_frame", "tool_link", "registration", "max_drift", "link_from_tip"):
            assert_same(getattr(found.robot, name), getattr(content.robot, name))
        assert [link.name for link in found.robot.robot.links] == [
            link.name for link in content.robot.robot.links
        ]
        assert (found.setup_id, found.model_id) == (content.setup_id, content.model_id)


def test_what_has_not_changed_is_the_same_object_in_the_next_content(contents):
    content = contents[1]
    writer, reader = SessionWire(), SessionWire()
    first = writer.description(DescribedSession(content))
    reader.meshes.update(writer.meshes)
    before = reader.described(first).content
    wider = replace(content, margins=content.margins.replaced(warn_mm=9.0))
    after = reader.described(writer.description(DescribedSession(wider))).content
    assert after.margins.warn_mm == 9.0
    assert after.replaced_since(before) == ("margins",)
    assert after.tumor is before.tumor
    assert after.robot is before.robot
    assert after.tool_from_tip is before.tool_from_tip


def test_description_of_another_version_or_without_its_meshes_is_refused(contents):
    writer = SessionWire()
    text = writer.description(DescribedSession(contents[0]))
    other = json.dumps({**json.loads(text), "version": VERSION + 1})
    with pytest.raises(InputError, match=f"not of version {VERSION}; expected a MarginGuard"):
        read(writer, other)
    with pytest.raises(InputError, match=r"mesh .*: not sent; expected it with what names it"):
        SessionWire().described(text)


def test_commands_are_read_as_they_were_sent(contents):
    content = contents[0]
    for command in (
        Rearm(3, 2**64 - 1),
        Record(True, "today"),
        AddNote("first cut \N{EM DASH} done"),
        SetTumor(content.frame_from_tumor, content.tumor, 0.25),
        SetRegistration(content.registration),
    ):
        writer, reader = SessionWire(), SessionWire()
        text = writer.command(command)
        reader.meshes.update(writer.meshes)
        found = reader.read_command(command.kind, text)
        for name in type(command).__dataclass_fields__:
            if name not in ("kind", "loosens"):
                assert_same(getattr(found, name), getattr(command, name))


@pytest.mark.parametrize(
    ("kind", "text", "problem"),
    [
        ("open_door", "{}", "command: 'open_door'; expected one of rearm, set_margins"),
        ("rearm", "[", "text of a session: .*; expected JSON"),
        ("rearm", "[" * 100_000, "text of a session: .*; expected JSON"),
        ("rearm", "[]", "Rearm: .*; expected its arguments"),
        ("rearm", '{"seq": 1}', "Rearm: KeyError: 'nonce'; expected its arguments"),
        ("rearm", '{"seq": 1, "nonce": 2, "more": 3}', "Extra fields in constructor for Rearm"),
        ("rearm", '{"seq": true, "nonce": 2}', "True: is no int; expected one"),
        ("rearm", '{"seq": 1.0, "nonce": 2}', "1.0: is no int; expected one"),
        ("record", '{"start": "yes"}', "'yes': is no bool; expected one"),
        ("needle_length", '{"by_mm": "5"}', "'5': is no number; expected one"),
        ("set_tumor", '{"frame_from_tumor": 3, "tumor": 4}', "SetTumor: .*; expected its arg"),
        ("note", '{"text": null}', "None: is no str; expected one"),
    ],
)
def test_what_is_no_command_is_refused_in_one_line(kind, text, problem):
    with pytest.raises(InputError, match=problem) as refused:
        SessionWire().read_command(kind, text)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_transform_that_is_not_finite_is_refused(number):
    edge = Transform("cautery", "cautery_tip", np.eye(3), [0.0, 0.0, 1.0])
    writer = SessionWire()
    text = json.loads(writer.command(SetTip(edge)))
    text["tool_from_tip"]["translation_mm"][2] = number
    with pytest.raises(MarginGuardError, match="finite"):
        writer.read_command("set_tip", json.dumps(text))


def test_robot_is_loaded_from_the_file_that_the_description_names(contents, tmp_path):
    content = contents[0]
    writer = SessionWire()
    gone = replace(content, robot_file=tmp_path / "gone.urdf")
    with pytest.raises(MarginGuardError, match=r"gone\.urdf"):
        read(writer, writer.description(DescribedSession(gone)))
    assert isinstance(content.robot_file, Path)
