"""The keys of ``stylus`` in ``case.yaml`` and in ``live.yaml``."""

from app.case.manifest.key_rules import MATRIX, RIGID
from app.files.keys import Block, Frame, Number, Numbers

MAX_STYLUS_SIGMA_MM = 10.0
"""Largest uncertainty of the tip of a stylus."""

MIN_STYLUS_MM = 1.0
"""A tip closer to the sensor's origin was never calibrated."""

OWN_STYLUS_FRAME = "stylus.frame is not reference, and not the frame of tool, tumour or needle"
STYLUS_TIP = "stylus.tip_from is 1 mm or more from the sensor's origin"

STYLUS = Block(
    "a tracked stylus, with which an operator touches points: no distance depends on it",
    {
        "frame": Frame("the tracked frame of its sensor"),
        "tip_from": Block(
            "pose of the tip in the tracked frame, +z forward; without it the stylus has to be "
            "calibrated before it can be used",
            {"matrix": Numbers(MATRIX, 16)},
            optional=True,
            rules=(RIGID,),
        ),
        "sigma_mm": Number(
            "standard deviation of the tip in its worst direction",
            default=0.0,
            minimum=0.0,
            maximum=MAX_STYLUS_SIGMA_MM,
        ),
    },
    optional=True,
    rules=(OWN_STYLUS_FRAME, STYLUS_TIP),
)
