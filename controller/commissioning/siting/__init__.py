"""Where inspection camera and fixed gripper should stand for a family of parts.

Arm, table and overhead camera stay where they are; the camera keeps its distance from the part.
planning-facts.md 3.1 (which side to look from) and 1.3 (what a plan needs).
"""

from ._report import SiteReport, reasons_to_move, site_report
from ._score import PartScore, SiteOptions, SiteScore
from ._search import find_sites
from ._site import Site, placed_at, site_of

__all__ = [
    "PartScore",
    "Site",
    "SiteOptions",
    "SiteReport",
    "SiteScore",
    "find_sites",
    "placed_at",
    "reasons_to_move",
    "site_of",
    "site_report",
]
