"""Files of the real stylus recording, and the transforms of its PLUS configuration."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

RECORDING = "EightLandmarkPointsTrackedForPhantomRegistration.igs.mha"
CONFIGURATION = "PlusDeviceSet_fCal_Sim_RecordPhantomLandmarks.xml"
PUBLISHED = "PhantomRegistrationLandmarkDetection.results.xml"


def plus_transform(file: Path, source: str) -> np.ndarray:
    """The (4, 4) matrix of the transform from ``source`` in a PLUS configuration."""
    entry = ElementTree.parse(file).find(f".//CoordinateDefinitions/Transform[@From='{source}']")
    return np.array([float(number) for number in entry.get("Matrix").split()]).reshape(4, 4)
