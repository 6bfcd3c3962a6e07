"""Schema 2 of case.yaml and live.yaml: lists of structures, tools and robots."""

import copy
import dataclasses
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml

from app.case import begin_case, open_case, open_live
from app.case.live_file import read_live
from app.case.manifest.case_file import read_manifest
from app.case.manifest.structures import as_schema_2
from app.geometry import FrameError, MarginGuardError, MeshError, Transform
from app.session import setup_from_case, with_repaired_meshes
from tests.case.conftest import IDENTITY, MANIFEST
from tests.case.test_session_values import VALUES
from tests.refusals import refused
from tests.schema_agreement import READERS, section_of
from tests.valid_documents import ROOT, VALID

pytestmark = pytest.mark.slow

WALL = {
    "name": "wall",
    "role": "forbidden",
    "frame": "reference",
    "mesh": {"path": "wall.stl", "units": "mm"},
    "pose": {"matrix": [1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, -40, 0, 0, 0, 1]},
    "margins": {"stop_mm": 2, "warn_mm": 6},
}
ROBOT = {
    "name": "arm",
    "holds": "cautery",
    "urdf": "arm/arm.urdf",
    "base_frame": "base",
    "tool_link": "tip",
    "registration": {"method": "given", "matrix": IDENTITY},
}


def two_structures() -> dict[str, Any]:
    """A case with a tumour and a wall."""
    values = copy.deepcopy(as_schema_2(MANIFEST))
    values["structures"].append(copy.deepcopy(WALL))
    return values


@pytest.fixture
def write(write_case):
    """Write a case with the mesh of the wall, whose faces ``change`` may damage."""

    def written(values, change=lambda faces: faces, **more):
        folder = write_case(values, **more)
        box = trimesh.creation.box((80.0, 80.0, 4.0))
        faces = change(np.array(box.faces))
        trimesh.Trimesh(box.vertices, faces, process=False).export(folder / "wall.stl")
        return folder

    return written


def test_shipped_case_has_three_structures_on_two_frames():
    case = open_case(ROOT / "data/structures_case")
    manifest = case.manifest
    found = [manifest.tumor, *manifest.structures]
    assert [(each.name, each.role, each.frame) for each in found] == [
        ("tumor", "target", "needle"),
        ("lesion_2", "target", "needle"),
        ("chest_wall", "forbidden", "reference"),
    ]
    assert [(each.margins.stop_mm, each.margins.warn_mm) for each in found] == [
        (1.0, 5.0),
        (1.0, 4.0),
        (2.0, 6.0),
    ]
    assert (manifest.margins.stop_mm, manifest.margins.k_tre) == (1.0, 2.0)
    assert [case.structure_mesh(each).frame for each in found] == [each.name for each in found]
    values = yaml.safe_load((case.folder / "case.yaml").read_text())
    for each, written in zip(found, values["structures"], strict=True):
        pose = each.frame_from_tumor
        assert (pose.target, pose.source) == (written["frame"], written["name"])
        np.testing.assert_allclose(pose.matrix.ravel(), written["pose"]["matrix"], atol=1e-12)
    (arm,) = manifest.arms
    assert (arm.name, arm.robot, arm.tool) == ("cautery", manifest.robot, manifest.tool)
    assert [each.name for each in case.expected().structures] == ["lesion_2", "chest_wall"]


def plain(value: Any) -> Any:
    """Numbers and texts of nested values, without what schema 2 adds to a structure."""
    if isinstance(value, Transform):
        return value.target, value.source, value.matrix.tolist()
    if dataclasses.is_dataclass(value):
        names = {field.name for field in dataclasses.fields(value)}
        if "frame_from_tumor" in names:
            names -= {"name", "role", "margins"}
        return {name: plain(getattr(value, name)) for name in names - {"arms", "file"}}
    if isinstance(value, dict):
        return {key: plain(each) for key, each in value.items()}
    return value


@pytest.mark.parametrize(
    ("document", "values"),
    [each for each in VALID if each[0] in ("case", "live") and each[1]["schema"] == 1],
)
def test_document_in_schema_2_has_the_values_of_schema_1(document, values):
    before = READERS[document](section_of(document, values))
    after = READERS[document](section_of(f"{document}-2", as_schema_2(values)))
    before, after = plain(before), plain(after)
    if "robot" not in values:  # nothing is registered, and schema 2 cannot state it
        manifest = before if document == "case" else before["case"]["manifest"]
        assert "registration" in manifest
        manifest["registration"] = None
    assert before == after


def test_recording_of_a_live_session_has_the_values_in_use(tmp_path):
    """All values that a recording in schema 1 has, and the further structures as they were."""
    folder = ROOT / "data/live_example"
    values = yaml.safe_load((folder / "live.yaml").read_text())
    box = trimesh.creation.box((80.0, 80.0, 4.0))
    box.export(tmp_path / "wall.stl")
    manifests = []
    for schema in (1, 2):
        if schema == 2:
            values = as_schema_2(values)
            values["structures"].insert(0, {**copy.deepcopy(WALL), "sigma_mm": 0.3})
            other = {**values["tools"][0], "name": "left", "frame": "left"}
            values["tools"].insert(0, other)
        path = tmp_path / "live.yaml"
        path.write_text(yaml.safe_dump(values))
        live = open_live(path)
        tool = None if schema == 1 else "cautery"
        live = dataclasses.replace(live, case=live.case.for_tool(tool))
        begin_case(live, tmp_path / f"case_{schema}", VALUES)
        written = tmp_path / f"case_{schema}" / "case.yaml"
        document = yaml.safe_load(written.read_text())
        name = "case" if schema == 1 else "case-2"
        manifests.append(READERS[name](section_of(name, document)))
    assert document["tools"][0] == other
    manifests[1] = manifests[1].for_tool("cautery")
    before, after = (plain(each) for each in manifests)
    (wall,) = manifests[1].structures
    assert (wall.name, wall.sigma_mm, wall.margins.stop_mm) == ("wall", 0.3, 2)
    assert (tmp_path / "case_2" / "wall.stl").is_file()
    assert before | {"structures": after["structures"]} == after
    assert after["margins"]["stop_mm"] == VALUES.margins.stop_mm


def edited(path: str, value: object) -> dict[str, Any]:
    """`two_structures` with one other value; `...` removes it."""
    values = two_structures()
    block: Any = values
    *places, key = path.split(".")
    for place in places:
        block = block[int(place) if isinstance(block, list) else place]
    if value is ...:
        del block[key]
    elif isinstance(block, list):
        block.append(value)
    else:
        block[key] = value
    return values


SECOND_ROBOT = [ROBOT, {**ROBOT, "name": "other", "base_frame": "other_base"}]

BAD: dict[str, tuple[str, object, str]] = {
    "name twice": (
        "structures.1.name", "tumor",
        "case.yaml: structures: 2 have the name 'tumor'; expected another one for each",
    ),
    "no frame": (
        "structures.1.frame", ...,
        "case.yaml: structures[1].frame is missing; expected the tracked frame",
    ),
    "no target": (
        "structures.0.role", "forbidden",
        "case.yaml: structures has no target; expected at least one: what is removed",
    ),
    "empty": (
        "structures", [], "case.yaml: structures is empty; expected at least one target",
    ),
    "many": (
        "structures", [{**WALL, "name": f"w{index}"} for index in range(1000)],
        "case.yaml: structures has 1000; expected at most 100",
    ),
    "not a list": ("structures", WALL, "case.yaml: structures is {'frame': 'refe"),
    "name of the reference": (
        "structures.1.name", "reference",
        "case.yaml: structures: the name 'reference' is that of another frame; "
        "expected a name of its own",
    ),
    "name of the frame of another": (
        "structures.1.name", "needle",
        "case.yaml: structures: the name 'needle' is that of another frame; "
        "expected a name of its own",
    ),
    "name of the tip": (
        "structures.1.name", "cautery_tip",
        "case.yaml: structures: the name 'cautery_tip' is that of another frame; "
        "expected a name of its own",
    ),
    "name with a comma": ("structures.1.name", "a,b", "case.yaml: structures[1].name: frame name"),
    "frame of the tool": (
        "structures.1.frame", "cautery",
        "case.yaml: structures.wall.frame is 'cautery', the frame of the tool; "
        "expected a frame that does not move with the tool",
    ),
    "unknown role": (
        "structures.1.role", "vessel",
        "case.yaml: structures[1].role is 'vessel'; expected one of target, forbidden",
    ),
    "warn below stop": (
        "structures.1.margins.warn_mm", 1,
        "case.yaml: structures[1].margins.warn_mm is 1; expected more than stop_mm (2)",
    ),
    "no margins": (
        "structures.1.margins", ...,
        "case.yaml: structures[1].margins is missing; expected distances",
    ),
    "margin of all in a structure": (
        "structures.1.margins.k_tre", 1,
        "case.yaml: structures[1].margins.k_tre is unknown; expected one of stop_mm, warn_mm",
    ),
    "margin of a structure in those of all": (
        "margins.stop_mm", 1, "case.yaml: margins.stop_mm is unknown; expected one of k_tre, ",
    ),
    "two robots hold one tool": (
        "robots", SECOND_ROBOT,
        "case.yaml: robots[1].holds is 'cautery', which another robot holds; "
        "expected one robot for a tool",
    ),
    "unknown tool held": (
        "robots", [{**ROBOT, "holds": "knife"}],
        "case.yaml: robots[0].holds is 'knife'; expected one of cautery",
    ),
    "no registration": (
        "robots", [{key: value for key, value in ROBOT.items() if key != "registration"}],
        "case.yaml: robots[0].registration is missing; expected one with a robot",
    ),
    "base with the name of a structure": (
        "robots", [{**ROBOT, "base_frame": "wall"}],
        "case.yaml: structures: the name 'wall' is that of another frame; "
        "expected a name of its own",
    ),
    "two tools on one frame": (
        "tools", [{**as_schema_2(MANIFEST)["tools"][0], "name": name} for name in ("a", "b")],
        "case.yaml: tools: 2 have the frame 'cautery'; expected another one for each",
    ),
    "no tools": ("tools", [], "case.yaml: tools is empty; expected at least one"),
    "schema 3": ("schema", 3, "case.yaml: schema is 3; expected 1 or 2"),
    "schema as text": ("schema", "2", "case.yaml: schema is '2'; expected 1 or 2"),
    "schema as boolean": ("schema", True, "case.yaml: schema is True; expected 1 or 2"),
    "keys of schema 2 in schema 1": (
        "schema", 1, "case.yaml: tools is unknown; expected one of schema, ",
    ),
    "keys of schema 1 in schema 2": (
        "tumor", MANIFEST["tumor"], "case.yaml: tumor is unknown; expected one of schema, ",
    ),
}  # fmt: skip


@pytest.mark.parametrize("fault", BAD)
def test_bad_input_is_refused_in_one_line(write, fault):
    path, value, message = BAD[fault]
    folder = write(edited(path, value), count=1)
    with refused(text=message, error=MarginGuardError) as caught:
        open_case(folder)
    assert str(caught.value).startswith(message)


def test_stylus_with_the_name_of_a_structure_is_refused(write):
    values = two_structures() | {"stylus": {"frame": "wall"}}
    with refused(text="structures: the name 'wall' is that of another frame; expected a name of"):
        open_case(write(values))


def test_dwells_of_any_robot_are_refused_live():
    live = next(values for name, values in VALID if name == "live-2")
    dwells = {"method": "paired_points", "dwells": [{"start_s": 0, "end_s": 1}]}
    tool, robot = live["tools"][0], live["robots"][0]
    other = {"name": "other", "frame": "other"}
    second = {"name": "other", "holds": "other", "base_frame": "other_base"}
    values = live | {
        "tools": [tool, tool | other],
        "robots": [robot, robot | second | {"registration": dwells}],
    }
    with refused(text="registration.dwells needs a recording"):
        read_live(section_of("live-2", values), ROOT / "live.yaml")


def test_first_target_is_the_tumour_wherever_it_stands():
    values = two_structures()
    values["structures"].reverse()
    manifest = read_manifest(section_of("case-2", values))
    assert manifest.tumor.name == "tumor"
    assert [each.name for each in manifest.structures] == ["wall"]
    assert manifest.margins.stop_mm == 1.0


def test_file_of_a_further_structure_has_to_exist(write):
    values = two_structures()
    values["structures"][1]["mesh"]["path"] = "none.stl"
    with refused(text="case.yaml: structures.wall.mesh.path"):
        open_case(write(values))


def test_mesh_of_a_further_structure_has_to_be_closed(write):
    case = open_case(write(two_structures(), lambda faces: faces[2:]))
    case.tumor_mesh()
    with refused(text="(case.yaml: structures.wall.mesh) is not closed", error=MeshError):
        setup_from_case(case)


def test_mesh_of_a_further_structure_is_repaired_on_request(write):
    values = two_structures()
    values["structures"][1]["mesh"]["repair"] = True
    folder = write(values, lambda faces: np.vstack([faces[:1, ::-1], faces[1:]]))
    case = with_repaired_meshes(open_case(folder))
    (wall,) = case.manifest.structures
    assert case.structure_mesh(wall).signed_volume_mm3 == pytest.approx(80.0 * 80.0 * 4.0)
    (note,) = case.notes()
    assert "structures.wall's mesh wall.stl was repaired" in note


def test_one_of_several_tools_is_chosen_by_its_name(write):
    values = two_structures()
    second = {**values["tools"][0], "name": "probe", "frame": "probe"}
    case = open_case(write(values | {"tools": [*values["tools"], second]}))
    assert case.manifest.tool.frame == "cautery"
    assert case.for_tool("probe").manifest.tool.frame == "probe"
    with refused(text="case.yaml: tools: none is named 'knife'; expected one of cautery, probe"):
        case.for_tool("knife")


def test_tools_that_no_session_guards_are_noted(write):
    values = two_structures()
    second = {**values["tools"][0], "name": "probe", "frame": "probe"}
    case = open_case(write(values | {"tools": [*values["tools"], second]}))
    setup_from_case(case, tip_only=True)
    assert case.notes() == (
        "tools: 2 are given; only 'cautery' is guarded; the distance between them is not checked "
        "without tool_distance_mm",
    )


def two_tools(**second):
    """A case with the tool twice, the second one on a sensor of its own."""
    values = two_structures()
    (tool,) = values["tools"]
    values["tools"].append({**copy.deepcopy(tool), "name": "left", "frame": "tracker", **second})
    return values | {"tool_distance_mm": 8}


def test_other_tool_is_measured_up_to_the_stated_distance(write):
    folder = write(two_tools())
    for name, other in (("cautery", "left"), ("left", "cautery")):
        case = open_case(folder).for_tool(name)
        setup = setup_from_case(case)
        (tool,) = setup.other_tools
        tips = tool.tool_from_tip.source, setup.tool_from_tip.source
        assert (tool.name, tool.warn_mm, tool.proximity.frames) == (other, 8.0, tips)
        assert tool.tool_from_tip.target in setup.shown_frames
        (note,) = case.notes()
        assert note == f"tools: 2 are given; only {case.manifest.tool.frame!r} is guarded"


def test_mesh_of_another_tool_is_repaired_on_request(write):
    mesh = {"path": "wall.stl", "units": "mm", "repair": True}
    folder = write(two_tools(mesh=mesh), lambda faces: np.vstack([faces[:1, ::-1], faces[1:]]))
    case = with_repaired_meshes(open_case(folder))
    assert case.other_tool_meshes()["left"].signed_volume_mm3 == pytest.approx(80.0 * 80.0 * 4.0)
    (note,) = case.notes()
    assert "tool 'left''s mesh wall.stl was repaired" in note


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"tool_distance_mm": -1}, "tool_distance_mm is -1; expected more than 0 to 200"),
        ({"tool_distance_mm": 0}, "tool_distance_mm is 0; expected more than 0 to 200"),
        ({"tool_distance_mm": float("nan")}, "tool_distance_mm is nan; expected a finite number"),
        ({"tool_distance_mm": float("inf")}, "tool_distance_mm is inf; expected a finite number"),
        ({"tool_distance_mm": 201}, "tool_distance_mm is 201; expected more than 0 to 200"),
        (
            {"tools": two_structures()["tools"]},
            "case.yaml: tool_distance_mm is given with one tool; expected another one in tools",
        ),
        (
            {"tools": two_tools(mesh=None)["tools"]},
            "case.yaml: tool_distance_mm is given, but tools.left.mesh is missing; expected one",
        ),
        (
            {"tools": two_tools(frame="cautery_tip")["tools"]},
            "case.yaml: tools: 2 have the frame 'cautery_tip'; expected another one for each",
        ),
        (
            {"tools": two_tools(name="wall")["tools"]},
            "structures and tools: 2 have the name 'wall'; expected another one for each",
        ),
    ],
)
def test_distance_between_tools_that_cannot_be_measured_is_refused(write, change, text):
    values = two_tools() | copy.deepcopy(change)
    values["tools"] = [
        {key: value for key, value in tool.items() if value is not None} for tool in values["tools"]
    ]
    with refused(text=text):
        open_case(write(values))


def test_open_mesh_of_another_tool_is_refused(write):
    case = open_case(write(two_tools(mesh={"path": "wall.stl", "units": "mm"}), lambda f: f[2:]))
    with refused(text="(case.yaml: tools.left.mesh) is not closed", error=MeshError):
        setup_from_case(case)


def test_missing_mesh_of_another_tool_is_refused(write):
    with refused(text="case.yaml: tools.left.mesh.path is 'none.stl'"):
        open_case(write(two_tools(mesh={"path": "none.stl", "units": "mm"})))


@pytest.mark.parametrize("number", [0, 1])
def test_structure_with_the_name_of_a_recorded_frame_is_refused(write, number):
    case = open_case(write(edited(f"structures.{number}.name", "tracker")))
    with refused(
        text="case.yaml: structures.tracker.name is that of a frame of the recording; expected a",
        error=FrameError,
    ):
        setup_from_case(case, tip_only=True)


def test_manifest_without_lists_names_no_tool(write_case, manifest):
    with refused(text="none is named 'cautery'; expected schema 2, which has names of tools"):
        open_case(write_case(manifest)).for_tool("cautery")
