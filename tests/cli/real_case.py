"""Wraps the real stylus recording in a case: a sphere around the phantom's first landmark."""

import re
import shutil
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import trimesh
import yaml

RECORDING = "EightLandmarkPointsTrackedForPhantomRegistration.igs.mha"
CONFIGURATION = "PlusDeviceSet_fCal_Sim_RecordPhantomLandmarks.xml"
PUBLISHED = "PhantomRegistrationLandmarkDetection.results.xml"
RADIUS_MM = 10.0


def plus_transform(file: Path, source: str) -> np.ndarray:
    """The (4, 4) matrix of the transform from ``source`` in a PLUS configuration."""
    entry = ElementTree.parse(file).find(f".//CoordinateDefinitions/Transform[@From='{source}']")
    return np.array([float(number) for number in entry.get("Matrix").split()]).reshape(4, 4)


def first_landmark(file: Path) -> np.ndarray:
    entry = ElementTree.parse(file).find(".//Landmarks/Landmark[@Name='#1']")
    return np.array([float(number) for number in entry.get("Position").split()])


def write_real_case(plus: Path, folder: Path) -> Path:
    """Write the case into ``folder``; ``plus`` holds the public recording."""
    folder.mkdir()
    shutil.copyfile(plus / RECORDING, folder / RECORDING)
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=RADIUS_MM)
    sphere.export(folder / "sphere.stl")
    at_landmark = np.eye(4)
    at_landmark[:3, 3] = first_landmark(plus / PUBLISHED)
    reference_from_tumor = plus_transform(plus / PUBLISHED, "Phantom") @ at_landmark
    stylus_from_tip = plus_transform(plus / CONFIGURATION, "StylusTip")
    manifest = {
        "schema": 1,
        "name": "eight landmarks",
        "provenance": {"kind": "recorded", "source": "PlusLibData", "licence": "BSD-3-Clause"},
        "recording": {"path": RECORDING},
        "tool": {"frame": "stylus", "tip_from": {"matrix": stylus_from_tip.ravel().tolist()}},
        "tumor": {
            "frame": "reference",
            "mesh": {"path": "sphere.stl", "units": "mm"},
            "pose": {"matrix": reference_from_tumor.ravel().tolist()},
        },
        "margins": {
            "stop_mm": 1.0,
            "warn_mm": 5.0,
            "k_tre": 2.0,
            "v_max_mm_s": 50,
            "stale_after_ms": 200,
        },
    }
    (folder / "case.yaml").write_text(yaml.safe_dump(manifest))
    return folder


def independent_distances_mm(plus: Path) -> np.ndarray:
    """Distances (n,) of the tip to the sphere, from the text of the file, without `app`."""
    text = (plus / RECORDING).read_bytes().decode("latin1")

    def matrices(name: str) -> np.ndarray:
        rows = re.findall(rf"_{name}ToTrackerTransform = ([^\r\n]*)", text)
        return np.array([[float(n) for n in row.split()] for row in rows]).reshape(-1, 4, 4)

    tip = plus_transform(plus / CONFIGURATION, "StylusTip")[:, 3]
    landmark = np.append(first_landmark(plus / PUBLISHED), 1.0)
    center = plus_transform(plus / PUBLISHED, "Phantom") @ landmark
    in_reference = np.linalg.inv(matrices("Reference")) @ matrices("Stylus") @ tip
    return np.linalg.norm((in_reference - center)[:, :3], axis=1) - RADIUS_MM
