"""Plausibility of measured poses: motion of each sensor, relations between measurements.

Pure: reads no clock. A pose that moves as its sensor cannot is not used, and measurements that
contradict each other are a fault of the margin.
"""
