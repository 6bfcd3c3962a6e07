"""The command ``marginguard``: parses arguments and connects the packages."""

import os

# The matrices are small: further threads of BLAS only wait for each other, and take processor time
# from the guard's neighbours (seven times as much where the cores are busy).
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
