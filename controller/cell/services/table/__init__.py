"""The table: which of the objects on it is the part to go on with, and what is left alone.

`choosing.py` has the rules, `taking.py` applies them to the batch at hand.
"""

from .choosing import LeftAlone, Wanted, candidates, chosen, where
from .taking import Taking

__all__ = ["LeftAlone", "Taking", "Wanted", "candidates", "chosen", "where"]
