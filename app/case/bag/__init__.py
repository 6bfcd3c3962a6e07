"""Recordings as rosbag2 folders in MCAP: read, written, and what their messages mean."""
