"""Find where inspection camera and fixed gripper should stand for a family of parts.

Arm, table and overhead camera stay where they are; the camera keeps its distance from the part. See
planning-facts.md 3.1 (which side to look from) and 1.3 (what a plan needs).
"""

from .report import SiteReport, reasons_to_move, site_report
from .score import PartScore, SiteOptions, SiteScore
from .search.sites import find_sites
from .site import CellSite, placed_at, site_of

__all__ = [
    "CellSite",
    "PartScore",
    "SiteOptions",
    "SiteReport",
    "SiteScore",
    "find_sites",
    "placed_at",
    "reasons_to_move",
    "site_of",
    "site_report",
]
