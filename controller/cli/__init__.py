"""The command line: a room per topic, with its commands and their work.

Each process computes with one thread: matrices are small here, so that threads of the numerical
libraries wait for one another longer than they compute, and other processes need the other cores.
The libraries read the variables below once, when they are imported, and child processes inherit
them. A user's own setting is kept.
"""

import os

# Variables of OpenBLAS, MKL and their builds with OpenMP: each also heeds OMP_NUM_THREADS, its own
# one first.
_MATRIX_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
if not any(name in os.environ for name in _MATRIX_THREADS):
    os.environ |= dict.fromkeys(_MATRIX_THREADS, "1")
os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")  # of OpenCV's loops over pixels

from .app import main  # noqa: E402  (the variables come first)

__all__ = ["main"]
