"""`cellctl history`: a list of parts, one part's full record, or an export."""

from collections.abc import Mapping
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
from ..inputs.history_store import filled_store, period
from ..terminal.figures_table import print_figures
from ..terminal.output import emit, print_line
from .arguments import HistoryOptions, PartFilter
from .tables import COLUMNS, part_row, print_columns, print_record

VERDICTS = ("pass", "fail", "indeterminate", "not evaluated", "no verdict")


def filters_of(recipe: str, chosen: PartFilter, verdict: str = "", review: str = "") -> Filters:
    """Return the store's filters for options of the command line.

    Parameters
    ----------
    recipe, verdict : of the parts; empty for any
    chosen : more that selects parts
    review : whether a person's verdict is awaited or there; empty for either

    Raises
    ------
    ConfigError : there is no such verdict, or a date is none
    """
    word = verdict.lower().replace("_", " ")
    if word and word not in VERDICTS:
        raise ConfigError(f"--verdict {verdict}: must be one of {', '.join(VERDICTS)}")
    since, until = period(chosen.since, chosen.until)
    return Filters(
        recipe=recipe,
        verdict=word,
        serial=chosen.serial,
        lot=chosen.lot,
        order_number=chosen.order_number,
        operator=chosen.operator,
        run=chosen.run,
        since=since,
        until=until,
        review=review,
        cell=chosen.cell,
    )


def answer(options: HistoryOptions) -> int:
    """Print the store's answer; return the exit code.

    Raises
    ------
    ConfigError : a filter or a file is wrong
    HistoryError : there is nothing to read, or no such part
    """
    part, by, file, as_json = options.part, options.by, options.export, options.as_json
    review: str = "awaiting" if options.awaits_review else "reviewed" if options.is_reviewed else ""
    filters = filters_of(options.recipe, options.chosen, options.verdict, review)
    if part is not None and (file is not None or filters != Filters()):
        raise ConfigError(f"PART {part}: cannot be combined with filters or --export")
    if by is not None and (by not in GROUPS or part is not None or file is not None):
        raise ConfigError(
            f"--by {by}: must be one of {', '.join(GROUPS)}, without PART and --export"
        )
    if file is not None:
        if file.suffix.lower() not in FORMS or file.is_dir():
            raise ConfigError(f"--export {file}: name a file that ends in {', '.join(FORMS)}")
        check_writable_folder(file.parent, "--export in")
    with filled_store(options.runs_dir, options.store_url, anew=options.is_refilled) as store:
        if part is not None:
            for record in find_parts(store, part):
                emit({"event": "part", **record}) if as_json else print_record(record)
        elif by is not None:
            print_figures(figures(store, filters, by), by, as_json=as_json)
        elif file is not None:
            count = export(store, filters, file, options.runs_dir)
            _print_written(file, count, as_json=as_json)
        else:
            _print_list(list_parts(store, filters, options.limit), as_json=as_json)
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
