"""Freed memory goes back to the system: what is said to glibc's allocator about large arrays.

By default each freed array of megabytes raises the size from which on an array has pages of its
own, up to 32 MB. Smaller ones then come from the heap of the thread that makes them, which keeps up
to twice that size for the next one: a process that looks at pictures in six threads keeps six times
as much as it ever needed. Other C libraries do without.
"""

import ctypes
import gc
from contextlib import suppress
from typing import Final

M_MMAP_THRESHOLD: Final = -3  # numbers of parameters in glibc's malloc.h
M_ARENA_MAX: Final = -8
# Size from which on an array has pages of its own, which go back when it does [bytes]. A picture's
# grey levels are larger, and what is made for each row or triangle smaller.
OWN_PAGES_BYTES: Final = 1 << 20


def map_large_arrays() -> None:
    """Have arrays of a megabyte in pages of their own, from now on and in every thread."""
    with suppress(AttributeError, OSError):  # another C library than glibc
        ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, OWN_PAGES_BYTES)


def share_one_heap() -> None:
    """Have all threads take memory from one heap; before the first thread.

    Each thread has a heap of its own otherwise, and keeps what it once needed: a process that waits
    for many things at once grows by that for hours.
    """
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).mallopt(M_ARENA_MAX, 1)


def give_back() -> None:
    """Return free memory that the allocator would keep in pieces, and `map_large_arrays`."""
    gc.collect()  # trimesh's meshes hold themselves in circles
    map_large_arrays()
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).malloc_trim(0)
