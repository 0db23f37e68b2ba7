"""`cellctl review`: list the parts that await a person, show one, write a person's verdict."""

import getpass
import webbrowser
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from controller.cell.journal import JOURNAL_NAME, JournalError
from controller.config import ConfigError
from controller.history import Store, folded, list_parts
from controller.history.reviewing import VERDICTS, WORDS, PartDecision, decide, one_part
from controller.results.review import PartCrops, write_review_page
from controller.results.run import ResultsError

from ..inputs.checks import check_writable_folder
from ..inputs.history_store import filled_store
from ..terminal.output import emit, print_line, warn
from .answering import filters_of
from .arguments import PartFilter, ReviewOptions
from .tables import instant_words, print_columns, print_record, review_word, tray_words

COLUMNS = (
    "begun (UTC)",
    "part",
    "serial",
    "recipe",
    "verdict",
    "tray",
    "findings",
    "why",
    "review",
)


def review_parts(order: ReviewOptions) -> int:
    """List parts, show one, or write a verdict; return the exit code.

    Raises
    ------
    ConfigError : the options do not go together, or one is wrong
    HistoryError : there is no such part, or no verdict can be written
    """
    _check(order)
    with filled_store(order.runs_dir, order.store_url) as store:
        if order.part is None:
            _list(store, order)
        elif order.verdict is None:
            _show(store, order, order.part)
        else:
            _decide(store, order, order.part, order.verdict)
    return 0


def _check(order: ReviewOptions) -> None:
    """Raise ConfigError if options do not go together."""
    if order.part is None and (order.verdict or order.output or order.is_opened):
        raise ConfigError("--verdict, --output and --open need PART: a serial number or RUN/NUMBER")
    if order.part is not None and (order.is_all or order.recipe or order.chosen != PartFilter()):
        raise ConfigError(f"PART {order.part}: cannot be combined with filters")
    if order.verdict is None and (order.why or order.who or order.findings):
        raise ConfigError("--why, --who and --finding require --verdict")
    if order.verdict is not None:
        if order.output or order.is_opened:
            raise ConfigError("--output and --open cannot be combined with --verdict")
        if order.verdict not in VERDICTS:
            raise ConfigError(f"--verdict {order.verdict}: must be one of {', '.join(VERDICTS)}")
        if not order.why.strip():
            raise ConfigError("--verdict needs --why: the journal keeps the reason")
    if order.output is not None:
        if order.output.is_dir():
            raise ConfigError(f"--output {order.output}: is a directory; name a file in it")
        check_writable_folder(order.output.parent, "--output in")


def _list(store: Store, order: ReviewOptions) -> None:
    filters = filters_of(order.recipe, order.chosen, review="awaiting")
    awaiting = list_parts(store, filters, order.limit)
    decided = None
    if order.is_all:
        decided = list_parts(store, replace(filters, review="reviewed"), order.limit)
    parts = [*awaiting.parts, *(decided.parts if decided else ())]
    if order.as_json:
        for one in parts:
            emit({"event": "part", **one})
        emit({"event": "listed", "awaiting": awaiting.count, "listed": len(parts)})
        return
    if parts:
        print_columns(COLUMNS, map(_row, parts))
    if not awaiting.count:
        print_line("no part awaits a person")
    elif len(awaiting.parts) < awaiting.count:
        print_line(
            f"{len(awaiting.parts):,} of {awaiting.count:,} that wait, newest first (--limit)"
        )


def _row(part: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        instant_words(part["start"]),
        str(part["part"]),
        str(part["serial"]),
        str(part["recipe"]),
        str(part["verdict"]),
        tray_words(part),
        str(part["finding_count"]),
        str(part["reason"]),
        review_word(part),
    )


def _show(store: Store, order: ReviewOptions, word: str) -> None:
    part, runs_dir = one_part(store, word), order.runs_dir
    crops = _crops(part, runs_dir)
    page = None
    if crops is not None:
        name = f"review_part{int(part['number']):03d}.html"
        page = write_review_page(crops, part, order.output or runs_dir / str(part["run"]) / name)
    pictures = {int(one["number"]): _picture(crops, int(one["number"])) for one in part["findings"]}
    if order.as_json:
        findings = [{**one, "picture": pictures[int(one["number"])]} for one in part["findings"]]
        emit({"event": "part", **part, "findings": findings, "page": str(page) if page else None})
    else:
        print_record(part)
        for number, file in pictures.items():
            if file:
                print_line(f"  picture of finding {number}: {file}")
        if page is not None:
            print_line(f"page with picture, prediction and difference: {page}")
        if part["awaits_review"]:
            print_line(f'decide: cellctl review {part["part"]} --verdict accept|reject --why "..."')
    if order.is_opened and page is not None and not webbrowser.open(page.resolve().as_uri()):
        warn(f"no browser was found; open {page} by hand")


def _crops(part: Mapping[str, Any], runs_dir: Path) -> PartCrops | None:
    """Return the crops of a part's findings; None, with a warning, if there are none."""
    run, number = str(part["run"]), int(part["number"])
    try:
        record = folded(runs_dir / JOURNAL_NAME, run, [number])
    except (JournalError, ResultsError) as error:
        warn(f"no page: {error}")
        return None
    return PartCrops.of_part(record, number)


def _picture(crops: PartCrops | None, number: int) -> str | None:
    found = None if crops is None else crops.of(number)
    if crops is None or found is None or not found.file:
        return None
    return str(crops.judged.pictures.folder / found.file)


def _decide(store: Store, order: ReviewOptions, word: str, verdict: str) -> None:
    user = getpass.getuser()
    who = f"{order.who} ({user})" if order.who else user
    decision = PartDecision(verdict, who, order.why, dict(map(_named, order.findings or ())))
    part = decide(store, order.runs_dir, word, decision)
    if order.as_json:
        emit({"event": "reviewed", **part})
        return
    before = len(part["reviews"]) - 1
    again = f", in place of {before} before" if before else ""
    print_line(f"{part['part']}: {verdict} by {who}{again}; the machine: {part['verdict']}")
    unnamed = [str(f["number"]) for f in part["findings"] if not f["review"]]
    if unnamed:
        print_line(
            f"finding {', '.join(unnamed)}: not named. `--finding {unnamed[0]}=real` or "
            "`=false_alarm` lets `cellctl stats --review` count how often the machine is "
            "right"
        )


def _named(text: str) -> tuple[int, str]:
    number, _, word = text.partition("=")
    word = word.strip().replace("-", "_")
    if not number.strip().isdecimal() or word not in WORDS:
        raise ConfigError(f"--finding {text}: must be N=real or N=false_alarm")
    return int(number), word
