"""Speed and accuracy, measured against peers and limits: see README.md.

One thread a process, as the Makefile has it: two torch threads on a busy machine are up to 100 times slower.
"""

import os

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
