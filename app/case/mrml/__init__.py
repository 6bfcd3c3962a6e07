"""Recordings that 3D Slicer's Sequences keep, in .mrml and .mrb files."""
