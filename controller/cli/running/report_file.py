"""`cellctl report`: the results of a run, from the journal."""

import errno
import json
import os
from pathlib import Path
from typing import Final

from controller.cell.journal import JournalError
from controller.config import ConfigError
from controller.results.judged import counted_parts
from controller.results.pages import write_page
from controller.results.report import report_json
from controller.results.run import ResultsError, load_run, note_results
from controller.results.writing import (
    FORM3_FORMATS,
    write_form3,
    write_html,
    write_parts,
    write_run_pdf,
)

from ..inputs.checks import check_writable_folder
from ..terminal.output import emit, print_line, warn

STANDARD: Final = "standard"
NO_ROOM: Final = (errno.ENOSPC, errno.EDQUOT)


def write_report(
    runs_dir: Path, run: str | None, form: str, output: Path | None, layout: str = STANDARD
) -> int:
    """Write the report of a run; return the exit code.

    Parameters
    ----------
    runs_dir : folder of all runs
    run : id, the beginning of an id, or folder of the run; None for the newest
    form : "html", "pdf", "json", "csv", "qif" or "dfq"
    output : file to write; None for a file in the run's folder, or JSON on stdout
    layout : `STANDARD`, or "as9102" for Form 3 of AS9102

    Raises
    ------
    ConfigError : the layout is of no such format, or the file cannot be written
    ResultsError : the run has nothing that the format could hold, or this machine makes no PDF
    """
    if layout != STANDARD and form not in FORM3_FORMATS:
        raise ConfigError(
            f"--layout {layout}: is a page to print; use --format {' or '.join(FORM3_FORMATS)}"
        )
    record = load_run(runs_dir, run)
    if form == "json":
        body = report_json(record)
        if output is None:
            emit(body)
        else:
            _check(output)
            write_page(json.dumps(body, indent=1, ensure_ascii=False), output)
            note_report(record.folder.parent, record.run_id, output)
            print_line(f"report: {output}")
        return 0
    name = "report" if layout == STANDARD else f"report-{layout}"
    path = output or record.folder / f"{name}.{form}"
    _check(path)
    if layout != STANDARD:
        write_form3(record, form, path)
    elif form == "html":
        write_html(record, path)
    elif form == "pdf":
        write_run_pdf(record, path)
    else:
        try:
            write_parts(counted_parts(record), form, path)
        except ValueError as error:
            raise ResultsError(f"run {record.run_id}: no {form} file, {error}") from error
    note_report(record.folder.parent, record.run_id, path)
    print_line(f"report: {path}")
    return 0


def note_report(runs_dir: Path, run_id: str, file: Path) -> None:
    """Append the hash of a report to the journal, if it is in the run's folder; else warn.

    Parameters
    ----------
    runs_dir, run_id : folder of runs, and id of the run
    file : the report, just written
    """
    try:
        note_results(runs_dir, run_id, [file])
    except (JournalError, OSError) as error:
        warn(f"{file}: its hash is not in the journal, which `cellctl verify` will report: {error}")


def warn_no_report(error: OSError, path: Path, run_id: str, runs_dir: Path) -> None:
    """Warn that a run's report was not written, and name the command to write it later.

    Parameters
    ----------
    error : reason; names the file, which may be one that the report is made of
    path : path of the report
    run_id, runs_dir : id of the run, and folder of runs
    """
    file = path if error.filename is None else Path(os.fsdecode(error.filename))
    reason = error.strerror or str(error)
    todo = "make room, then " if error.errno in NO_ROOM else ""
    # a report is written beside its place first, so that its own file has another name at times
    if file.parent != path.parent:
        reason = f"{reason}; the report {path} needs it"
    warn(f"cellctl: {file}: {reason}; {todo}`cellctl report {run_id} --runs {runs_dir}` writes it")


def _check(output: Path) -> None:
    """Raise ConfigError if no report can be written."""
    if output.is_dir():
        raise ConfigError(f"--output {output}: is a directory; name a file in it")
    check_writable_folder(output.parent, "--output in")
