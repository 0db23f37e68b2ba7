"""The table: which of the objects on it is the part to go on with, and what is left alone."""

from .choosing import Wanted, candidates, chosen, where

__all__ = ["Wanted", "candidates", "chosen", "where"]
