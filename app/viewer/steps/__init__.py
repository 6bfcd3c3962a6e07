"""What there is to show: the steps of a session that runs, or of a recording."""
