"""Texts that the declarations of several keys share."""

RIGID = "a matrix is rigid: orthonormal without reflection, last row 0 0 0 1"
MATRIX = "16 numbers row by row, in mm"
