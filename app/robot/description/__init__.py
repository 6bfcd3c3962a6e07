"""Loaders of robot descriptions: URDF, xacro and AMBF."""
