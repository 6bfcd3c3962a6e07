"""ROS messages of recordings without ROS: their definitions, their CDR bytes, their values."""
