"""The keys of ``needle`` in ``case.yaml`` and in ``live.yaml``."""

from app.case.manifest.plausibility_keys import NO_DIRECTION
from app.files.keys import Block, Choice, Frame, Number, Numbers, Text
from app.files.meshes import UNITS_MM

MIN_NEEDLE_MM, MAX_NEEDLE_MM = 1.0, 500.0
"""Lengths of a needle, in its file and as an operator sets it."""

NOT_THE_TOOL = "needle.frame is not the frame of the tool"

NEEDLE = Block(
    "the tracked needle, which is shown and nothing else: no distance depends on it",
    {
        "frame": Frame("the tracked frame of its sensor, often that of the tumour"),
        "length_mm": Number(
            "from the sensor to the tip", minimum=MIN_NEEDLE_MM, maximum=MAX_NEEDLE_MM
        ),
        "tip_from": Block(
            "where the tip is, seen from the sensor; by default along its z axis",
            {"direction": Numbers("direction from the sensor to the tip: 3 numbers", 3)},
            optional=True,
            rules=(NO_DIRECTION,),
        ),
        "model": Block(
            "surface in the frame of the tip, the tip at 0 and +z forward; by default a thin "
            "needle of that length",
            {
                "path": Text("mesh file (.stl, .ply, .obj), relative, absolute or package://..."),
                "units": Choice("unit of the file's coordinates", tuple(UNITS_MM)),
            },
            optional=True,
        ),
    },
    optional=True,
    rules=(NOT_THE_TOOL,),
)
