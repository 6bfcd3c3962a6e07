"""Compile ROS 2 interface packages with pip: the part of colcon that PyPI has no wheel for.

`package` reads a folder of interface files, `generate` runs the official generators on it, `link`
compiles their output, and `command` ties the three to setuptools.
"""
