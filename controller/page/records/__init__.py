"""Parts of all runs for the screens: queried in threads, store and drawings in another process.

The page's loop waits for none of it, and the cell is not involved.
"""

from .files import FORMS, LISTED_FORMS, WantedFile
from .pictures import PartPicture
from .records import ELSEWHERE, NEWER_S, Records
from .shown import (
    page_asked,
    page_count,
    part_key,
    unread,
    verdict_class,
)

__all__ = [
    "ELSEWHERE",
    "FORMS",
    "LISTED_FORMS",
    "NEWER_S",
    "PartPicture",
    "Records",
    "WantedFile",
    "page_asked",
    "page_count",
    "part_key",
    "unread",
    "verdict_class",
]
