"""Forward and inverse kinematics of a tree of joints."""
