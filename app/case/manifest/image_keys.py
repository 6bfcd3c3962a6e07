"""The keys of ``images`` in ``case.yaml``."""

from app.files.keys import Block, Choice, Frame, Number, Text

ORIENTATIONS = ("MF", "MN", "UF", "UN", "FM", "NM", "FU", "NU")
"""Directions of columns and rows: M marked, U unmarked side of the probe, F far from it, N near."""

_YEAR_MS = 365 * 86_400_000

IMAGES = Block(
    "tracked ultrasound images",
    {
        "path": Text(
            "sequence with images (.igs.mha, .igs.mhd, .igs.nrrd, .igs.nhdr) and the poses of the "
            "probe, on the clock of the tracker; by default the recording",
            optional=True,
        ),
        "probe": Frame("the tracked frame of the probe"),
        "calibration": Text("ImageToProbe: a PLUS configuration (.xml) or a transform file"),
        "orientation": Choice(
            "orientation of images whose header names none", ORIENTATIONS, optional=True
        ),
        "stale_after_ms": Number(
            "maximum age of an image that is shown; by default that of margins",
            optional=True,
            above=0.0,
            maximum=_YEAR_MS,
        ),
    },
    optional=True,
)
