"""Build ROS 2 interface packages with pip, without colcon, which has no wheel for this step.

`package` reads a folder of interface files, `generate` runs the official generators on it, `link`
compiles and links their output, and `command` is the setuptools command that calls the three.
"""
