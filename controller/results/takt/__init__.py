"""Takt: the use of the arm's time, folded from the journal; a run's time is the arm's.

`uses.py` names the uses of time, `_spans.py` cuts a run's rows into spans of one use each,
`folding.py` adds them up by part and by run, `groups.py` by common properties of runs.
"""

from .folding import PartTakt, RunTakt, takt_of, takts_of
from .groups import GROUPS, TaktGroup, grouped, run_takt, takt_json, takt_line
from .uses import BUSY, TimeUse

__all__ = [
    "BUSY",
    "GROUPS",
    "PartTakt",
    "RunTakt",
    "TaktGroup",
    "TimeUse",
    "grouped",
    "run_takt",
    "takt_json",
    "takt_line",
    "takt_of",
    "takts_of",
]
