"""Values of the page beside the picture: state, reasons, numbers, the distance over time."""
