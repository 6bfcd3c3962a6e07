"""cohort.yaml: what it may hold, and one clear line for everything else."""

import json
from pathlib import Path

import jsonschema
import pytest
import yaml

from app.cli.main import main
from app.cohort import COHORT, OPTION_RANGES, Design, open_manifest, write_manifest
from app.files import schema_text
from app.geometry import InputError

ROOT = Path(__file__).resolve().parents[2]
CHECK = jsonschema.Draft202012Validator(json.loads(schema_text(COHORT, "cohort")))
SIMULATED = {
    "schema": 1,
    "name": "all keys",
    "simulated": {
        "count": 4,
        "seed": 0,
        "trackers": ["white", "polaris"],
        "surgeons": 2,
        "fixture": "off",
        **{key: [option.low, option.high] for key, option in OPTION_RANGES.items()},
    },
}
RECORDED = {
    "schema": 1,
    "name": "recorded",
    "cases": [
        {"name": "a", "source": "one", "group": "g", "surgeon": "s", "pair": "p"},
        {"name": "b", "source": "s3://bucket/two"},
    ],
}


def write(folder, document):
    path = folder / "cohort.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


def test_simulated_cohort_is_read(tmp_path):
    CHECK.validate(SIMULATED)
    cohort = open_manifest(write(tmp_path, SIMULATED))
    assert (cohort.name, len(cohort), len(list(cohort))) == ("all keys", 4, 4)
    assert cohort.design is not None and set(cohort.design.ranges) == set(OPTION_RANGES)


def test_recorded_cases_are_relative_to_the_manifest(tmp_path):
    CHECK.validate(RECORDED)
    write(tmp_path, RECORDED)
    first, second = open_manifest(tmp_path)
    assert (first.name, first.source) == ("a", str(tmp_path / "one"))
    assert (first.group, first.surgeon, first.pair) == ("g", "s", "p")
    assert second.source == "s3://bucket/two" and second.group == ""
    assert open_manifest(tmp_path).case("b") == second


def test_written_manifest_is_read_again(tmp_path):
    design = Design(3, 5, ("aurora",), ranges={"tumor_mm": (20.0, 21.5)})
    write_manifest(tmp_path / "new", "name", design)
    assert open_manifest(tmp_path / "new").design == design
    CHECK.validate(yaml.safe_load((tmp_path / "new" / "cohort.yaml").read_text()))
    with pytest.raises(InputError, match="already exists"):
        write_manifest(tmp_path / "new", "name", design)


def changed(document, place, value):
    copied = json.loads(json.dumps(document))
    *path, key = place
    target = copied
    for step in path:
        target = target[step]
    if value is None:
        del target[key]
    else:
        target[key] = value
    return copied


@pytest.mark.parametrize(
    ("document", "message"),
    [
        (changed(RECORDED, ["cases", 1, "name"], "a"), r"two cases have the name 'a': .*one and"),
        (changed(RECORDED, ["cases"], None), "both or none of simulated, cases"),
        ({**RECORDED, **SIMULATED}, "both or none of simulated, cases"),
        (changed(RECORDED, ["cases"], []), "cases is empty; expected cases"),
        (changed(RECORDED, ["cases", 0, "sourse"], "x"), "sourse is unknown.*did you mean"),
        (changed(SIMULATED, ["simulated", "count"], 0), "count is 0; expected"),
        (changed(SIMULATED, ["simulated", "fixture"], "maybe"), "fixture is 'maybe'; expected one"),
        (changed(SIMULATED, ["simulated", "trackers"], ["x"]), "tracker 'x' is not known"),
        (changed(SIMULATED, ["simulated", "skill"], [1, 0]), "skill is .1, 0.; expected"),
        (changed(SIMULATED, ["simulated", "skill"], [0]), "skill is 1 values; expected a list"),
        (changed(SIMULATED, ["simulated", "seed"], None), "seed is missing"),
        (changed(SIMULATED, ["schema"], 2), "schema is 2; expected 1"),
    ],
)
def test_bad_manifest_is_one_clear_line(tmp_path, document, message):
    with pytest.raises(InputError, match=message) as error:
        open_manifest(write(tmp_path, document))
    assert "\n" not in str(error.value)


def test_committed_schema_is_the_generated_one(capsys):
    assert main(["doctor", "schema", "cohort"]) == 0
    assert capsys.readouterr().out == schema_text(COHORT, "cohort")
    committed = ROOT / "docs" / "schemas" / "cohort.schema.json"
    assert committed.read_text() == schema_text(COHORT, "cohort"), (
        "run: marginguard doctor schema cohort -o docs/schemas/cohort.schema.json"
    )
