"""What became of a run: read from the journal, never in the control path.

`load_run` folds a run's journal into a `RunRecord`, `write_html` makes the page that an inspector
signs, `report_json` the same for machines.
"""

from .report import SCHEMA_VERSION, report_json, write_html
from .run import ResultsError, RunRecord, RunSummary, list_runs, load_run

__all__ = [
    "SCHEMA_VERSION",
    "ResultsError",
    "RunRecord",
    "RunSummary",
    "list_runs",
    "load_run",
    "report_json",
    "write_html",
]
