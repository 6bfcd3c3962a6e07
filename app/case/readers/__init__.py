"""Readers of recordings, one module or sub-package per format.

Each declares a `RecordingFormat` as its ``FORMAT``. `app.case.readers.recording_format` finds all
of them, so a new format is one new file in this folder. Files and folders are recognised without
loading the reader itself: import it inside the functions of ``FORMAT`` where it is slow to load.
"""
