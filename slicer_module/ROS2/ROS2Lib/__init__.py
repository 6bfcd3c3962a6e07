"""What the module ROS2 is made of; the calls of scripts are in `node` and `logic`."""
