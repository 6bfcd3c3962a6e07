"""ROS 2: what a session finds, sent to the ROS graph. The only room that imports rclpy."""
