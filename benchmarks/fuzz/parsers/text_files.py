"""Files of numbers and names: YAML, transforms, landmarks, PLUS configurations."""

import io
from collections.abc import Sequence
from pathlib import Path

from app.files import read_landmarks, read_plus_config, read_transform
from app.files.bounded_io import read_bounded
from app.files.hdf5_transforms import read_hdf5_matrices
from app.files.shipped import shipped
from app.files.signal_file import read_signal
from app.files.yaml_file import load_yaml
from benchmarks.fuzz.forked import start_forked_hdf5
from benchmarks.fuzz.mutators.raw import RAW
from benchmarks.fuzz.mutators.text import TEXT
from benchmarks.fuzz.mutators.tree import mutate_json, mutate_xml
from benchmarks.fuzz.mutators.yaml_text import YAML
from benchmarks.fuzz.parser import MAX_INPUT_BYTES, FuzzedParser

_MATRIX = "1 0 0 10 0 0 -1 20 0 1 0 30 0 0 0 1"
_ITK = """#Insight Transform File V1.0
# NeedleToReference
#Transform 0
Transform: AffineTransform_double_3_3
Parameters: 1 0 0 0 0 -1 0 1 0 10 20 30
FixedParameters: 1 2 3
"""
_TRANSFORM = """transform: NeedleToReference
target: reference
source: needle
matrix: [1.0, 0.0, 0.0, 10.0, 0.0, 1.0, 0.0, 20.0, 0.0, 0.0, 1.0, 30.0, 0.0, 0.0, 0.0, 1.0]
"""
_LANDMARKS = """# phantom
landmarks:
  - {name: A, position_mm: [1.0, 2.0, 3.0]}
  - {name: B, position_mm: [-1.5, 2.0e+1, 3.0]}
  - name: "C d"
    position_mm: &origin
      - 0.0
      - 0.0
      - 0.0
  - {name: D, position_mm: *origin}
"""
_MARKUPS = """{"@schema": "markups-schema-v1.0.3.json", "markups": [{"type": "Fiducial",
"coordinateSystem": "LPS", "coordinateUnits": "mm", "locked": false, "controlPoints": [
{"id": "1", "label": "F-1", "position": [1.5, -2.0, 3e1], "positionStatus": "defined",
 "orientation": [-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0], "selected": true},
{"id": "2", "label": "F-2", "position": [4.0, 5.0, 6.0], "positionStatus": "undefined"},
{"id": "3", "label": "F-3", "position": [7, 8, 9]}], "display": {"color": [0.4, 1.0, 1.0]}}]}
"""
_FIDUCIALS = """# Markups fiducial file version = 4.11
# CoordinateSystem = LPS
# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID
1,1.5,-2.0,30,0,0,0,1,1,1,0,F-1,,
2,4,5,6,0,0,0,1,1,1,0,"F,2",,
3,7,8,9,0,0,0,1,1,1,0,F-3,"text",
"""
_OLD_FIDUCIALS = """# Fiducial List file /tmp/F.fcsv
# version = 2
# name = F
# columns = label,x,y,z,sel,vis
F-1,1.5,-2.0,30,1,1
"F,2",4,5,6,1,1
"""
_SIGNAL = """time_s,line_px
0.0,100.5
0.033,101.25
"0.066",-3e2
"""
_PLUS = f"""<?xml version="1.0"?>
<PlusConfiguration version="2.9"><CoordinateDefinitions>
<Transform From="StylusTip" To="Stylus" Matrix="{_MATRIX}" Error="0.5" Date="2020"/>
<Transform From="Image" To="Probe" Matrix="0.1 0 0 0 0 0.1 0 0 0 0 0.1 0 0 0 0 1"/>
</CoordinateDefinitions><PhantomDefinition><Description Name="fCAL"/><Geometry><Landmarks>
<Landmark Name="#1" Position="-15 20 5"/><Landmark Name="#2" Position="104.3 -5.0 0.0"/>
</Landmarks></Geometry></PhantomDefinition></PlusConfiguration>
"""


def _yaml_seeds() -> Sequence[bytes]:
    cases = (("recorded_case", "case.yaml"), ("live_example", "live.yaml"))
    shipped_files = [shipped("data", *parts).read_bytes() for parts in cases]
    return [_TRANSFORM.encode(), _LANDMARKS.encode(), *shipped_files]


def _hdf5_seeds() -> Sequence[bytes]:
    """A transform of ITK in its present and its older layout."""
    import h5py
    import numpy as np

    seeds = []
    for prefix in ("Transform", "Tranform"):
        content = io.BytesIO()
        with h5py.File(content, "w") as file:
            group = file.create_group("TransformGroup/0")
            group["TransformType"] = ["AffineTransform_double_3_3"]
            group[f"{prefix}Parameters"] = np.append(np.eye(3).ravel(), [1.0, 2.0, 3.0])
            group[f"{prefix}FixedParameters"] = np.zeros(3)
        seeds.append(content.getvalue())
    return seeds


def _read_hdf5(path: Path) -> None:
    content = read_bounded(path, MAX_INPUT_BYTES)
    read_hdf5_matrices([content], [str(path)], start=start_forked_hdf5)


def _read_plus(path: Path) -> None:
    found = read_plus_config(path)
    found.transform("stylus", "stylus_tip")


PARSERS = (
    FuzzedParser("yaml", "document.yaml", load_yaml, _yaml_seeds, YAML),
    FuzzedParser(
        "transform_yaml",
        "needle.yaml",
        lambda path: read_transform(path, target="reference", source="needle"),
        lambda: [_TRANSFORM.encode()],
        YAML,
    ),
    FuzzedParser(
        "transform_itk",
        "needle.tfm",
        lambda path: read_transform(path, target="reference", source="needle"),
        lambda: [_ITK.encode(), _MATRIX.encode()],
        TEXT,
    ),
    FuzzedParser(
        "landmarks_yaml", "points.yaml", read_landmarks, lambda: [_LANDMARKS.encode()], YAML
    ),
    FuzzedParser(
        "markups",
        "points.mrk.json",
        read_landmarks,
        lambda: [_MARKUPS.encode()],
        (*TEXT, *[mutate_json] * len(TEXT)),
    ),
    FuzzedParser(
        "fiducials",
        "points.fcsv",
        read_landmarks,
        lambda: [_FIDUCIALS.encode(), _OLD_FIDUCIALS.encode()],
        TEXT,
    ),
    FuzzedParser("signal", "line.csv", read_signal, lambda: [_SIGNAL.encode()], TEXT),
    FuzzedParser("transform_hdf5", "needle.h5", _read_hdf5, _hdf5_seeds, RAW),
    FuzzedParser(
        "plus_config",
        "plus.xml",
        _read_plus,
        lambda: [_PLUS.encode()],
        (*TEXT, *[mutate_xml] * len(TEXT)),
    ),
)
