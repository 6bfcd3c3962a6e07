"""Points to points, to landmarks and to surfaces: where a robot or a phantom lies."""
