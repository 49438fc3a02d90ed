"""Speed beside peers, each in one run."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command `sinew` does, before NumPy is there
