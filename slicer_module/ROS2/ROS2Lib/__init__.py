"""Parts of the module ROS2; the calls of scripts are in `node` and `logic`."""
