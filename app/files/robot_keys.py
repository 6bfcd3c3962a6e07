"""Keys of a robot's file, the same in ``case.yaml``, ``world.yaml`` and ``control.yaml``."""

import re

from app.files.keys import Text, Texts

ROBOT_FILE = Text(".urdf, .xacro or AMBF .yaml, relative, absolute or package://NAME/...")

XACRO_ARGS = Texts(
    "values of the arguments of a .xacro, by name",
    re.compile(r"[^\W\d]\w*"),
    "the name of a xacro argument",
    plain_values=True,
    optional=True,
)
