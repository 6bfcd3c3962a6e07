"""The rows of the fault matrix: each injects one fault and judges what follows."""
