"""Metrics, evaluations, reports and commands."""

import os

# All matrices are small: OpenBLAS waited 0.6 s of a start for its second thread while the core was busy.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
