"""`cellctl stats --review`: the agreement of persons with the machine."""

from rich import box
from rich.table import Table

from controller.history.reviewing import Agreement, Rate, Reviewed, agreement, agreement_json

from ..inputs.history_store import filled_store
from ..terminal.figures_table import print_table
from ..terminal.output import emit, print_line
from .arguments import StatsOptions
from .yields import filters_of

TEXT_COLUMNS = 200
VERDICT_COLUMNS = ("recipe", "the machine", "the person", "parts")
FINDING_COLUMNS = (
    "recipe", "finding", "face", "real", "false alarms", "share", "95 %", "not named", "",
)  # fmt: skip
LISTED_COUNT = 20  # unreviewed, likely false alarms that are listed


def report_agreement(options: StatsOptions) -> int:
    """Print the agreement of persons with the machine; return the exit code.

    Raises
    ------
    ConfigError : a date is none
    HistoryError : there is nothing to read
    """
    filters = filters_of(options)
    with filled_store(options.runs_dir, options.store_url) as store:
        found = agreement(store, filters)
    if options.as_json:
        for line in agreement_json(found):
            emit(line)
    else:
        _print(found)
    return 0


def _print(found: Agreement) -> None:
    if not found.verdicts:
        print_line("no person has decided on a part yet (`cellctl review`)")
    else:
        rows = [(*names, str(n)) for names, n in found.verdicts.items()]
        print_table(Table(box=box.SIMPLE_HEAD), VERDICT_COLUMNS, rows, TEXT_COLUMNS)
    if found.findings:
        of_findings = [_row(one) for one in found.findings]
        print_table(Table(box=box.SIMPLE_HEAD), FINDING_COLUMNS, of_findings, TEXT_COLUMNS)
    if found.missed.total:
        print_line(
            f"passed by the machine and decided on by a person: {found.missed.total}, of them "
            f"rejected: {found.missed.count} ({_interval_words(found.missed)})"
        )
    if found.awaiting:
        print_line(f"parts that await a person: {found.awaiting} (`cellctl review`)")
    for one in found.likely[:LISTED_COUNT]:
        group = one.reviewed
        print_line(
            f"likely a false alarm: finding {one.number} of {one.part}, {group.kind} on "
            f"{group.face or 'no face'}; {_interval_words(group.false_alarms)} were"
        )
    if len(found.likely) > LISTED_COUNT:
        print_line(f"and {len(found.likely) - LISTED_COUNT} more (--json)")


def _row(one: Reviewed) -> tuple[str, ...]:
    rate = one.false_alarms
    share = rate.share
    lower, upper = rate.interval
    return (
        one.recipe,
        one.kind,
        one.face or "(none)",
        str(rate.total - rate.count),
        str(rate.count),
        "–" if share is None else f"{100 * share:.0f} %",
        "–" if share is None else f"{100 * lower:.0f} to {100 * upper:.0f} %",
        str(one.unnamed),
        "likely false alarms" if one.is_likely_false else "",
    )


def _interval_words(rate: Rate) -> str:
    """Return a share with its interval in words."""
    lower, upper = rate.interval
    return f"{rate.count} of {rate.total}, 95 %: {100 * lower:.0f} to {100 * upper:.0f} %"
