"""Clusters under lamps taken apart: parts that touch, and parts that lie on others (ADR 70)."""

from .parts import parts_of_lit
from .search import widened

__all__ = ["parts_of_lit", "widened"]
