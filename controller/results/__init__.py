"""Results: runs folded from the journal, judged parts, their reports and exports. Controls nothing.

`load_run` folds a run's journal into a `RunRecord`, `judged_parts` are its parts with all data for
a report, `judged_part` the same of an inspection without a run. `write_html` makes the page that an
inspector signs, `report_json` the same for machines; `qif_bytes`, `dfq_bytes` and `csv_text` are
for other programs, `write_report` writes any of them by the suffix of the file, `write_form3` the
characteristics in the layout of Form 3 of AS9102. `plan_page` and `sheet` draw a plan and compiled
parts.
"""

from .exports import csv_text, dfq_bytes, qif_bytes
from .judged import Header, JudgedPart, counted_parts, judged_part, judged_parts, result_json
from .report import SCHEMA_VERSION, PdfError, report_json
from .run import (
    ResultsError,
    RunProof,
    RunRecord,
    RunSummary,
    UnknownRunError,
    list_runs,
    load_run,
    note_results,
    prove_run,
)
from .writing import (
    FORM3_FORMATS,
    SUFFIXES,
    write_form3,
    write_html,
    write_parts,
    write_report,
    write_run_pdf,
)

__all__ = [
    "FORM3_FORMATS",
    "SCHEMA_VERSION",
    "SUFFIXES",
    "Header",
    "JudgedPart",
    "PdfError",
    "ResultsError",
    "RunProof",
    "RunRecord",
    "RunSummary",
    "UnknownRunError",
    "counted_parts",
    "csv_text",
    "dfq_bytes",
    "judged_part",
    "judged_parts",
    "list_runs",
    "load_run",
    "note_results",
    "prove_run",
    "qif_bytes",
    "report_json",
    "result_json",
    "write_form3",
    "write_html",
    "write_parts",
    "write_report",
    "write_run_pdf",
]
