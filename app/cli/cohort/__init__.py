"""The command ``marginguard cohort``: cases on the workers of Dask distributed."""
