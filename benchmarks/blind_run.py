"""`cellctl`, whose interpreter can be told to stand still; see `bench_blind.py`.

    python blind_run.py FD ARGUMENTS...

Each line of seconds on the file descriptor keeps the interpreter's lock for so long, as a full
garbage collection of a large heap does: no thread of it runs meanwhile.
"""

import ctypes
import os
import sys
import threading

from controller.cli.app import main


def obey(fd: int) -> None:
    """Stand still as often as told to."""
    usleep = ctypes.PyDLL(None).usleep  # PyDLL keeps the lock during the call
    with os.fdopen(fd) as orders:
        for line in orders:
            usleep(round(float(line) * 1e6))


if __name__ == "__main__":
    threading.Thread(target=obey, args=(int(sys.argv[1]),), daemon=True).start()
    sys.exit(main(sys.argv[2:]))
