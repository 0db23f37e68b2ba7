"""``python -m emulators``: the emulated cell on its wires."""

import os
import sys

# Numerical libraries that start a thread a core fight with the controller for two of them
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

if __name__ == "__main__":  # the picture worker imports this module, too
    from emulators.app import main

    sys.exit(main())
