"""Clusters under lamps: parts that touch, and parts that lie on others, separated (ADR 92)."""

from .parts import parts_of_lit
from .search import widened

__all__ = ["parts_of_lit", "widened"]
