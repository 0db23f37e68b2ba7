"""The archive judged anew: parts of the store, by their stored pictures and another recipe.

`archive.py` chooses them, `task.py` judges one in any process, `results.py` keeps what came of it
in the store alone and tells what turned. The journal stays as it is (ADR 125).
"""

from .archive import Archive, NewJudging, counts, judging_by_recipe, parts_left
from .results import NOT_JUDGED, PartTurn, compared, keep
from .task import ArchivedPart, Rejudged, rejudge

__all__ = [
    "NOT_JUDGED",
    "Archive",
    "ArchivedPart",
    "NewJudging",
    "PartTurn",
    "Rejudged",
    "compared",
    "counts",
    "judging_by_recipe",
    "keep",
    "parts_left",
    "rejudge",
]
