"""The table: the object to take next, and the objects left alone.

`choosing.py` has the rules, `taking.py` applies them to the present batch, `labels.py` has serial
numbers and lots. `preparation.py` has the plans made before any look, `ahead.py` the next part
planned beside the current one.
"""

from .ahead import Foreseen, LookAhead
from .choosing import LeftAlone, WantedParts, candidates, chosen, where
from .labels import NO_NUMBERS, SCAN, Label, LabelOrder, Labels, counted, parted, why_no_serial
from .preparation import Preparation
from .taking import Taking

__all__ = [
    "NO_NUMBERS",
    "SCAN",
    "Foreseen",
    "Label",
    "LabelOrder",
    "Labels",
    "LeftAlone",
    "LookAhead",
    "Preparation",
    "Taking",
    "WantedParts",
    "candidates",
    "chosen",
    "counted",
    "parted",
    "where",
    "why_no_serial",
]
