"""What a session finds, as messages: tf, the constraint, markers, diagnostics."""
