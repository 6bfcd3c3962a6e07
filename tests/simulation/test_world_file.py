"""world.yaml: what it may hold, and one clear line for everything else."""

import json
import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import yaml

from app.cli.main import main
from app.files import schema_text
from app.files.meshes import write_mesh
from app.geometry import InputError
from app.simulation import WORLD, World, WorldError, open_world
from tests.case.test_schemas import _paths
from tests.simulation.conftest import LUMPECTOMY, ROOT, flat_sheet

pytestmark = pytest.mark.slow

Edit = Callable[[dict[str, Any]], object]
CHECK = jsonschema.Draft202012Validator(json.loads(schema_text(WORLD, "world")))


def shipped() -> dict[str, Any]:
    values: dict[str, Any] = yaml.safe_load((LUMPECTOMY / "world.yaml").read_text())
    return values


def write(folder: Path, values: dict[str, Any]) -> Path:
    (folder / "chest_wall.stl").write_bytes((LUMPECTOMY / "chest_wall.stl").read_bytes())
    path = folder / "world.yaml"
    path.write_text(yaml.safe_dump(values))
    return path


def test_shipped_world_is_read():
    world = open_world(LUMPECTOMY)
    assert (world.name, world.seed, world.timestep_ns) == ("lumpectomy", 20, 1_000_000)
    (arm,), (wall,), (tumor,) = world.robots, world.bodies, world.tissues
    assert arm.robot.name == "touch" and arm.positions["shoulder"] == 1.0
    assert arm.tool is not None and arm.tool.link_from_tool.translation_mm.tolist() == [0, 0, 70]
    assert wall.mass_kg is None and wall.collision == "parts"
    assert np.degrees(tumor.breath_turn_rad) == pytest.approx([0.86, 0.34, 0])
    assert world.tracker is not None and world.tracker.metal == ("arm", "touch_base", "stylus")
    model = world.tracker.model
    assert (model.rate_hz, model.latency_s, model.correlation_s) == (50.0, 0.02, 0.5)
    assert (model.white.position_rms_mm, model.slow.position_rms_mm) == (0.0, 0.3)
    assert world.hand is not None and world.hand.pushes[1].retreat
    CHECK.validate(shipped())


def test_committed_mesh_is_that_of_its_script(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["make_meshes.py", str(tmp_path)])
    runpy.run_path(str(LUMPECTOMY / "make_meshes.py"), run_name="__main__")
    committed = (LUMPECTOMY / "chest_wall.stl").read_bytes()
    assert (tmp_path / "chest_wall.stl").read_bytes() == committed


def test_committed_schema_is_the_generated_one(capsys):
    assert main(["doctor", "schema", "world"]) == 0
    assert capsys.readouterr().out == schema_text(WORLD, "world")
    committed = ROOT / "docs" / "schemas" / "world.schema.json"
    assert committed.read_text() == schema_text(WORLD, "world"), (
        "run: marginguard doctor schema world -o docs/schemas/world.schema.json"
    )


def _place(values: Any, path: str) -> tuple[Any, str]:
    """The innermost dictionary or list of a path such as ``robots.0.file``, and its last key."""
    *places, key = path.split(".")
    for place in places:
        values = values[int(place) if isinstance(values, list) else place]
    return values, key


def _set(path: str, value: object) -> Edit:
    def edit(values: Any) -> None:
        inner, key = _place(values, path)
        inner[key] = value

    return edit


def _remove(path: str) -> Edit:
    def edit(values: Any) -> None:
        inner, key = _place(values, path)
        del inner[key]

    return edit


STATED: dict[str, tuple[Edit, str]] = {
    "unknown key": (_set("robots.0.colour", 1), r"robots\[0\]\.colour is unknown; expected one of"),
    "mass 0": (_set("robots.0.tool.mass_kg", 0), r"mass_kg is 0; expected more than 0"),
    "mass of a text": (_set("robots.0.tool.mass_kg", "1e3"), r"mass_kg is '1e3'; expected a numb"),
    "long time step": (_set("physics", {"timestep_ms": 20.0}), r"timestep_ms is 20; expected more"),
    "time step 0": (_set("physics", {"timestep_ms": 0.0}), r"timestep_ms is 0; expected more than"),
    "no seed": (_remove("seed"), r"seed is missing"),
    "other schema": (_set("schema", 2), r"schema is 2; expected 1"),
    "collision": (_set("bodies.0.collision", "mesh"), r"collision is 'mesh'; expected one of hull"),
    "position": (_set("bodies.0.position_mm", [1, 2]), r"position_mm is 2 values; expected a list"),
    "no pushes": (_set("hand.pushes", []), r"hand\.pushes is empty; leave it out"),
    "dead zone": (_set("hand.joy.dead", 1.0), r"dead is 1; expected 0\.0 to 0\.9"),
    "device": (_set("hand.device.period_ms", 0), r"period_ms is 0; expected 0\.5 to 20"),
    "rate": (_set("tracker.rate_hz", 0), r"rate_hz is 0; expected 1\.0 to 250"),
}
"""Faults that the schema states, too."""

UNSTATED: dict[str, tuple[Edit, str]] = {
    "mesh": (_set("bodies.0.mesh.path", "a.stl"), r"mesh\.path is 'a\.stl': no such file in"),
    "missing robot": (_set("robots.0.file", "arm.urdf"), r"file is 'arm\.urdf': no such file"),
    "joint": (
        _set("robots.0.positions.0.joint", "hip"),
        r"joint is 'hip': no actuated joint; expected one of waist, shoulder",
    ),
    "joint twice": (
        _set("robots.0.positions.1.joint", "shoulder"),
        r"joint is 'shoulder': given twice; expected one of",
    ),
    "link": (_set("robots.0.tool.link", "hand"), r"tool\.link is 'hand'; expected one of touch_b"),
    "fixed mass": (_set("bodies.0.mass_kg", 1.0), r"mass_kg is given for a fixed body; expected"),
    "free mass": (_set("bodies.0.motion", "free"), r"mass_kg is missing for a free body; expected"),
    "same name": (_set("bodies.0.name", "tumor"), r"name 'tumor' is used twice; expected unique"),
    "interval": (
        _set("hand.pushes.0.end_s", 0.5),
        r"end_s is 0\.5; expected a time after start_s \(1",
    ),
    "push": (_set("hand.pushes.0.towards", "liver"), r"pushes names 'liver'; expected one of"),
    "hand": (_set("hand.robot", "leg"), r"hand\.robot is 'leg'; expected the name of a robot with"),
    "axis": (_set("hand.joy.axes", [0, 0, 1]), r"axes is .*; expected three different integers"),
    "sign": (_set("hand.joy.signs", [1, 2, 1]), r"signs is .*; expected 1 or -1 for each"),
    "topic": (_set("hand.joy.topic", "joy"), r"topic is 'joy'; expected a name such as /joy"),
    "stiff spring": (
        _set("hand.device.stiffness_n_m", 134),
        r"stiffness_n_m: .* is 134; expected below 133\.3 for its damping, scale, period and delay",
    ),
    "tracked": (_set("tracker.tracked", ["leg"]), r"tracker\.tracked names 'leg'; expected one of"),
}
"""Faults that only the reader finds."""


@pytest.mark.parametrize("fault", [*STATED, *UNSTATED])
def test_fault_is_refused_in_one_line(tmp_path, fault):
    edit, message = (STATED | UNSTATED)[fault]
    values = shipped()
    edit(values)
    assert CHECK.is_valid(values) == (fault in UNSTATED)
    with pytest.raises(WorldError, match=message) as refused:
        open_world(write(tmp_path, values))
    assert "\n" not in str(refused.value)


def test_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"is not a world; expected a world\.yaml or its folder"):
        open_world(tmp_path)


def test_every_key_is_used_by_the_worlds_of_the_tests():
    complete = shipped()
    complete["physics"] = {"timestep_ms": 0.5, "gravity_mm_s2": 9810.0}
    complete["tracker"]["model"] = "aurora"
    complete["robots"][0] |= {
        "xacro_args": {"side": "left"}, "max_effort": 5.0, "collision": "hull", "friction": 0.2,
        "self_collision": True, "position_mm": [0, 0, 0], "rotation_deg": [0, 0, 90],
    }  # fmt: skip
    complete["robots"][0]["tool"] |= {"friction": 0.1, "collision": "none", "rotation_deg": [0] * 3}
    complete["bodies"][0] |= {"mass_kg": 1.0, "friction": 0.5, "rotation_deg": [1, 2, 3]}
    complete["hand"]["joy"] |= {"topic": "/spacenav/joy", "signs": [1, -1, 1]}
    complete["hand"]["device"] |= {"rotation_deg": [0, 0, 90]}
    complete["tissues"][0] |= {"rotation_deg": [1, 2, 3]}
    CHECK.validate(complete)
    used = {path for path in _paths(complete) if not path.startswith("robots.xacro_args.")}
    assert used == set(_declared(WORLD))


def _declared(block: Any, place: str = "") -> Any:
    for name, key in block.keys.items():
        yield f"{place}{name}"
        inner = getattr(key, "items", key)
        if hasattr(inner, "keys"):
            yield from _declared(inner, f"{place}{name}.")


NOT_SIMULATED = [
    (
        _remove("robots.0.density_kg_m3"),
        r"link 'torso' of robot 'arm' has no mass; expected one in the robot's file, or dens",
    ),
    (
        _set("bodies.0.mesh.path", "flat.stl"),
        r"its surface encloses no volume; expected a body of three dimensions",
    ),
]


@pytest.mark.parametrize(("edit", "message"), NOT_SIMULATED)
def test_world_that_cannot_be_simulated_is_refused(tmp_path, edit, message):
    write_mesh(tmp_path / "flat.stl", flat_sheet())
    values = shipped()
    values["bodies"][0]["collision"] = "hull"
    edit(values)
    with pytest.raises(WorldError, match=message):
        World(open_world(write(tmp_path, values)))
