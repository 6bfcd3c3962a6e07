"""A cohort with more workers: `marginguard bench cohort`."""
