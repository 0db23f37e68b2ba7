"""A run, folded from the rows of its journal.

`load.py` finds runs, `_fold.py` and `_parts.py` fold their rows into the `RunRecord` of `model.py`,
`log_words.py` puts a row in words, `proof.py` finds later changes, `copies/` reads pictures, from
the folder or from the store of objects that they were copied to.
"""

from ._fold import entry_of, fold
from ._parts import PartFold
from ._stored import copies_in, stored_files
from .copies import ChangedFileError, ObjectsError, ObjectStore, RunPictures, WrongObjectError
from .load import RunSummary, find_run, list_runs, load_run, whole_journal
from .log_words import row_words, stage_words
from .model import (
    Box,
    Copy,
    DeviceReport,
    FindingReport,
    LogEntry,
    PartReport,
    Points,
    ResultsError,
    ReviewReport,
    RunOutcome,
    RunRecord,
    SightingReport,
    StageReport,
    StepReport,
    UnknownRunError,
    ViewReport,
)
from .proof import PICTURES, RunProof, Tampering, note_results, prove_run

__all__ = [
    "PICTURES",
    "Box",
    "ChangedFileError",
    "Copy",
    "DeviceReport",
    "FindingReport",
    "LogEntry",
    "ObjectStore",
    "ObjectsError",
    "PartFold",
    "PartReport",
    "Points",
    "ResultsError",
    "ReviewReport",
    "RunOutcome",
    "RunPictures",
    "RunProof",
    "RunRecord",
    "RunSummary",
    "SightingReport",
    "StageReport",
    "StepReport",
    "Tampering",
    "UnknownRunError",
    "ViewReport",
    "WrongObjectError",
    "copies_in",
    "entry_of",
    "find_run",
    "fold",
    "list_runs",
    "load_run",
    "note_results",
    "prove_run",
    "row_words",
    "stage_words",
    "stored_files",
    "whole_journal",
]
