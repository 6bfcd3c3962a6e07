"""Images of IGSIO sequences: their layout, their pixels, their poses and the probe's calibration.

Headers are read by `app.case.readers.igsio.igsio_header`. Pixels are read one image at a time.
"""
