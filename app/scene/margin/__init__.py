"""The displayed margin of a decision, and its nodes."""
