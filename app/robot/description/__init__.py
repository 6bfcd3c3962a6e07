"""From a description, URDF, xacro or AMBF, to a robot."""
