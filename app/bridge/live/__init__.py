"""A live session on the ROS graph: its sources, its outputs, its recorder, its lifecycle."""
