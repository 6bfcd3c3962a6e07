"""Where the tip of a tracked tool is, and which way its shaft points."""
