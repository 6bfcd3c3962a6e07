"""A live session and its recorder under constant load for a long time."""
