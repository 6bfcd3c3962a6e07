"""What may be shown of a decision, and the nodes that show it."""
