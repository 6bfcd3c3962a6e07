"""Texts and patterns that the declarations of several keys share."""

import re

RIGID = "a matrix is rigid: orthonormal without reflection, last row 0 0 0 1"
MATRIX = "16 numbers row by row, in mm"
TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
TOPIC_EXPECTED = "a topic that begins with '/', of letters, digits and underscores"
