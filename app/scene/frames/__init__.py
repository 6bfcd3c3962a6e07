"""Transform nodes, edits by the user, and the freshness of transforms."""
