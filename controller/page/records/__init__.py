"""Parts of all runs, for the screens that show them: asked in threads, filled and drawn apart.

The page's loop waits for none of it, and the cell knows nothing of it.
"""

from .records import NEWER_S, Records
from .shown import (
    page_asked,
    page_count,
    part_key,
    report_file,
    unread,
    verdict_class,
)

__all__ = [
    "NEWER_S",
    "Records",
    "page_asked",
    "page_count",
    "part_key",
    "report_file",
    "unread",
    "verdict_class",
]
