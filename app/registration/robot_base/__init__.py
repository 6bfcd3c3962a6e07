"""Registration of a robot's base, and the offset between its clock and the tracker's."""
