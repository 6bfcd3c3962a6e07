"""Where a robot's base stands, and how its clock runs beside the tracker's."""
