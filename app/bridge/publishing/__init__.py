"""Publishers of a session: tf, the constraint, markers, diagnostics."""
