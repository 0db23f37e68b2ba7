"""Parts for a person to decide on: the verdict goes into the journal, beside the machine's.

`deciding.py` writes it, `agreement.py` counts how often persons and machine agree.
"""

from .agreement import (
    LIKELY_SHARE,
    Agreement,
    LikelyFalseAlarm,
    Rate,
    Reviewed,
    agreement,
    agreement_json,
)
from .deciding import VERDICTS, WORDS, PartDecision, decide, one_part

__all__ = [
    "LIKELY_SHARE",
    "VERDICTS",
    "WORDS",
    "Agreement",
    "LikelyFalseAlarm",
    "PartDecision",
    "Rate",
    "Reviewed",
    "agreement",
    "agreement_json",
    "decide",
    "one_part",
]
