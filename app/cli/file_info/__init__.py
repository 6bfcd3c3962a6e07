"""Descriptions of single files for ``marginguard info``: what it is, its use, what is missing."""
