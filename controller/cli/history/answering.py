"""`cellctl history`: a list of parts, one part's full record, or an export."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from controller.config import ConfigError
from controller.history import (
    FORMS,
    GROUPS,
    Filters,
    Listed,
    export,
    figures,
    find_parts,
    list_parts,
)

from ..inputs.checks import check_writable_folder
from ..inputs.history_store import filled_store, instant
from ..terminal.figures_table import print_figures
from ..terminal.output import emit, print_line
from .tables import COLUMNS, part_row, print_columns, print_record

VERDICTS = ("pass", "fail", "indeterminate", "not evaluated", "no verdict")


@dataclass(frozen=True, slots=True)
class FilterWords:
    """The filters as words of the command line."""

    recipe: str = ""
    verdict: str = ""
    serial: str = ""
    lot: str = ""
    order_number: str = ""
    operator: str = ""
    run: str = ""
    since: str | None = None
    until: str | None = None
    review: str = ""
    cell: str = ""

    def filters(self) -> Filters:
        """Return the store's filters for these options.

        Raises
        ------
        ConfigError : there is no such verdict, or a date is none
        """
        verdict = self.verdict.lower().replace("_", " ")
        if verdict and verdict not in VERDICTS:
            raise ConfigError(f"--verdict {self.verdict}: must be one of {', '.join(VERDICTS)}")
        return Filters(
            recipe=self.recipe,
            verdict=verdict,
            serial=self.serial,
            lot=self.lot,
            order_number=self.order_number,
            operator=self.operator,
            run=self.run,
            since=None if self.since is None else instant(self.since, "--since"),
            until=None if self.until is None else instant(self.until, "--until", is_end=True),
            review=self.review,
            cell=self.cell,
        )


def answer(
    part: str | None,
    asked: FilterWords,
    limit: int,
    by: str | None,
    file: Path | None,
    runs_dir: Path,
    url: str | None,
    *,
    anew: bool,
    as_json: bool,
) -> int:
    """Print the store's answer; return the exit code.

    Parameters
    ----------
    part : serial number or RUN/NUMBER; None for a list
    asked : parts to list
    limit : largest number
    by : one of `GROUPS` to count the parts; None to list them
    file : file to export to; None to print
    runs_dir : folder of all runs
    url : URL of the store; None for the folder's own
    anew : fill it from the journals' first row on
    as_json : print JSON lines instead of a table

    Raises
    ------
    ConfigError : a filter or a file is wrong
    HistoryError : there is nothing to read, or no such part
    """
    filters = asked.filters()
    if part is not None and (file is not None or asked != FilterWords()):
        raise ConfigError(f"PART {part}: cannot be combined with filters or --export")
    if by is not None and (by not in GROUPS or part is not None or file is not None):
        raise ConfigError(
            f"--by {by}: must be one of {', '.join(GROUPS)}, without PART and --export"
        )
    if file is not None:
        if file.suffix.lower() not in FORMS or file.is_dir():
            raise ConfigError(f"--export {file}: name a file that ends in {', '.join(FORMS)}")
        check_writable_folder(file.parent, "--export in")
    with filled_store(runs_dir, url, anew=anew) as store:
        if part is not None:
            for record in find_parts(store, part):
                emit({"event": "part", **record}) if as_json else print_record(record)
        elif by is not None:
            print_figures(figures(store, filters, by), by, as_json=as_json)
        elif file is not None:
            count = export(store, filters, file, runs_dir)
            _print_written(file, count, as_json=as_json)
        else:
            _print_list(list_parts(store, filters, limit), as_json=as_json)
    return 0


def _print_written(file: Path, count: int, *, as_json: bool) -> None:
    what = "parts" if file.suffix.lower() == ".qif" else "rows"
    if as_json:
        emit({"event": "exported", "file": str(file), what: count})
    else:
        print_line(f"export: {file}, {count:,} {what}")


def _print_list(listed: Listed, *, as_json: bool) -> None:
    parts: tuple[Mapping[str, Any], ...] = listed.parts
    if as_json:
        for one in parts:
            emit({"event": "part", **one})
        emit({"event": "listed", "count": listed.count, "listed": len(parts)})
        return
    if not parts:
        print_line("no part fits")
        return
    if len({one["cell"] for one in parts}) > 1:
        print_columns((*COLUMNS, "cell"), ((*part_row(one), str(one["cell"])) for one in parts))
    else:
        print_columns(COLUMNS, map(part_row, parts))
    if len(parts) < listed.count:
        print_line(f"{len(parts):,} of {listed.count:,} parts, newest first (--limit)")
