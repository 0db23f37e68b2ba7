"""Imports of the computing modules, without the garbage collector.

A command imports modules of several hundred thousand objects. All of them stay, and the collector
would examine each several times during the imports: a seventh of the time to the first line of
work.
"""

import gc
from collections.abc import Iterator
from contextlib import contextmanager

_is_frozen = False  # whether somebody has frozen: to count what is frozen, Python visits it all


@contextmanager
def loading() -> Iterator[None]:
    """Import without collection; the objects of the first import are never examined again."""
    global _is_frozen
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if not _is_frozen:
            _is_frozen = True
            if not gc.get_freeze_count():
                gc.freeze()
        if was_enabled:
            gc.enable()
