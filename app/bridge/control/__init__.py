"""Control interface: allowed twist, lifecycle, margins and operator services."""
