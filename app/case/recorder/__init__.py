"""Writers of recordings: an MCAP file of frames, and a rosbag2 folder of live messages."""
