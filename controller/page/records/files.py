"""Files that a person takes along: a run, a part, or all parts of a list, in a form of its own."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from controller.cad import Solid
from controller.cell.journal import JOURNAL_NAME, JournalError
from controller.history import Filters, HistoryError, export, folded, open_store
from controller.results.judged import counted_parts, judged_parts
from controller.results.judged.cad import solid_in_run
from controller.results.run import ResultsError, RunRecord, load_run
from controller.results.writing import write_form3, write_html, write_parts, write_run_pdf

FORMS: Final[Mapping[str, str]] = {
    "html": "text/html; charset=utf-8",
    "pdf": "application/pdf",
    "csv": "text/csv; charset=utf-8",
    "qif": "application/xml",
    "as9102": "application/pdf",  # in the layout of its Form 3
}
LISTED_FORMS: Final = ("csv", "qif")  # forms for lists of parts of several runs


@dataclass(frozen=True, slots=True)
class WantedFile:
    """Content of a file to write.

    Attributes
    ----------
    form : one of `FORMS`
    run, number : a part, or a whole run where the number is 0; empty for what `filters` let through
    filters : parts of all runs to include
    """

    form: str
    run: str = ""
    number: int = 0
    filters: Filters | None = None

    @property
    def name(self) -> str:
        """The file's name."""
        part = f"-part{self.number:03d}" if self.number else ""
        ending = "-as9102.pdf" if self.form == "as9102" else f".{self.form}"
        return f"{self.run}{part}{ending}" if self.run else f"parts{ending}"


def write_wanted(url: str, runs_dir: Path, wanted: WantedFile, path: Path) -> str:
    """Write a file; return the reason if it was not written, else empty.

    Parameters
    ----------
    url : URL of the store
    runs_dir : folder of all runs
    wanted : filters
    path : its place, with the suffix of its form
    """
    try:
        if wanted.filters is not None:
            store = open_store(url)
            try:
                export(store, wanted.filters, path, runs_dir)
            finally:
                store.close()
        elif wanted.number:
            record = folded(runs_dir / JOURNAL_NAME, wanted.run, [wanted.number])
            if wanted.form == "as9102":
                write_form3(judged_parts(record), "pdf", path, _solid(record))
            else:
                write_parts(judged_parts(record), wanted.form, path, _solid(record))
        else:
            _write_run(load_run(runs_dir, wanted.run), wanted.form, path)
    except (HistoryError, JournalError, ResultsError, OSError, ValueError) as error:
        return str(error)
    return ""


def _write_run(record: RunRecord, form: str, path: Path) -> None:
    if form == "html":
        write_html(record, path)
    elif form == "pdf":
        write_run_pdf(record, path)
    elif form == "as9102":
        write_form3(record, "pdf", path)
    else:
        write_parts(counted_parts(record), form, path)


def _solid(record: RunRecord) -> Solid | None:
    """Return the CAD model of the part of a record, for the drawings of its report."""
    found = solid_in_run(record, record.parts[0]) if record.parts else ""
    return found if isinstance(found, Solid) else None
