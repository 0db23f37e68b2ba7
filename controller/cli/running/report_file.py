"""`cellctl report`: what a run found, from the journal."""

import json
from pathlib import Path

from controller.config import ConfigError
from controller.results import load_run, report_json, write_html

from ..inputs.checks import check_writable_folder
from ..terminal.output import emit, print_line


def write_report(runs_dir: Path, run: str | None, form: str, output: Path | None) -> int:
    """Write the report of a run; return the exit code.

    Parameters
    ----------
    runs_dir : folder of all runs
    run : id, the beginning of an id, or folder of the run; None for the newest
    form : "html" or "json"
    output : file to write; None for report.html of the run, or JSON on stdout
    """
    record = load_run(runs_dir, run)
    if form == "json":
        body = report_json(record)
        if output is None:
            emit(body)
        else:
            _check(output)
            output.write_text(json.dumps(body, indent=1, ensure_ascii=False), encoding="utf-8")
            print_line(f"report: {output}")
        return 0
    path = output or runs_dir / record.run_id / "report.html"
    _check(path)
    print_line(f"report: {write_html(record, path)}")
    return 0


def _check(output: Path) -> None:
    """Raise ConfigError where no report can be written."""
    if output.is_dir():
        raise ConfigError(f"--output {output}: is a directory; name a file in it")
    check_writable_folder(output.parent, "--output in")
