"""The steps to be shown: of a live session, or of a recording."""
