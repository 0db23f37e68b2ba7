"""The table: which of the objects on it is the part to go on with, and what is left alone.

`choosing.py` has the rules, `taking.py` applies them to the batch at hand, `ahead.py` has the next
part planned beside the one at hand.
"""

from .ahead import Foreseen, LookAhead
from .choosing import LeftAlone, Wanted, candidates, chosen, where
from .taking import Taking

__all__ = [
    "Foreseen",
    "LeftAlone",
    "LookAhead",
    "Taking",
    "Wanted",
    "candidates",
    "chosen",
    "where",
]
