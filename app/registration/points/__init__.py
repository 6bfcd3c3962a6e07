"""Registration by points: paired points, landmarks touched in any order, and surfaces."""
