"""Results: runs folded from the journal, and pages of runs, plans and parts. Controls nothing.

`load_run` folds a run's journal into a `RunRecord`, `write_html` makes the page that an inspector
signs, `report_json` the same for machines. `plan_page` and `sheet` draw a plan and compiled parts.
"""

from .report import SCHEMA_VERSION, report_json, write_html
from .run import (
    ResultsError,
    RunRecord,
    RunSummary,
    UnknownRunError,
    list_runs,
    load_run,
)

__all__ = [
    "SCHEMA_VERSION",
    "ResultsError",
    "RunRecord",
    "RunSummary",
    "UnknownRunError",
    "list_runs",
    "load_run",
    "report_json",
    "write_html",
]
