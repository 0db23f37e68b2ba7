"""Parts of the history as tables for people."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from controller.results.wording import num, span

from ..terminal.output import print_line, printable, stdout

TEXT_COLUMNS = 220
REVIEWS_COUNT = 5  # last reviews of a part that are printed
COLUMNS = (
    "begun (UTC)", "part", "serial", "lot", "recipe", "operator", "verdict", "tray", "s",
    "forecast", "findings", "recoveries", "review",
)  # fmt: skip


def print_columns(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table, wide if there is no terminal."""
    table = Table(box=box.SIMPLE_HEAD)
    for name in columns:
        table.add_column(Text(name), overflow="fold")
    for row in rows:
        # as Text: rich would read brackets as markup
        table.add_row(*(Text(printable(cell, stdout.encoding)) for cell in row))
    console = stdout
    if not stdout.is_terminal:
        console = Console(file=stdout.file, width=TEXT_COLUMNS, highlight=False)
    console.print(table)


def part_row(part: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the cells of a part in the list."""
    is_done = part["done_forecast_s"] > 0
    return (
        instant_words(part["start"]),
        str(part["part"]),
        str(part["serial"]),
        str(part["lot"]),
        str(part["recipe"]),
        str(part["operator"]),
        str(part["verdict"]),
        str(part["tray"]) or str(part["custody"]).replace("_", " "),
        num(part["done_actual_s"]) if is_done else "–",
        num(part["done_forecast_s"]) if is_done else "–",
        str(part["finding_count"]),
        str(part["recovery_count"]),
        review_word(part),
    )


def instant_words(at: object) -> str:
    """Return an instant of the store, in ISO form, to the second."""
    return str(at)[:19].replace("T", " ")


def review_word(part: Mapping[str, Any]) -> str:
    """Return a person's review of a part, in a word."""
    return str(part["review"]) or ("awaited" if part["awaits_review"] else "–")


def tray_words(part: Mapping[str, Any]) -> str:
    """Return the tray and nest of a part, or its place elsewhere."""
    if not part["tray"]:
        return f"none, {str(part['custody']).replace('_', ' ')}"
    return f"{part['tray']}, nest {part['nest']}" if part["nest"] else str(part["tray"])


def print_record(part: Mapping[str, Any]) -> None:
    """Print everything known of a part."""
    print_line(f"{part['part']}: {str(part['verdict']).upper()}", style="bold")
    emulated = " (emulated)" if part["is_emulated"] else ""
    about = {
        "serial": part["serial"],
        "lot": part["lot"],
        "order": part["order_number"],
        "recipe": part["recipe"],
        "cell": f"{part['cell']}{emulated}",
        "operator": part["operator"],
        "begun": f"{instant_words(part['start'])} UTC, {span(part['wall_s'])}",
        "tray": tray_words(part),
        "run": f"{part['run']}, {part['outcome']}",
        "reason": part["reason"],
    }
    if part["awaits_review"]:
        about["review"] = "awaits a person (`cellctl review`)"
    for name, value in about.items():
        if value:
            print_line(f"  {name:9} {value}")
    for one in part["reviews"][-REVIEWS_COUNT:]:
        by = f"{one['who']}, {instant_words(one['at'])} UTC"
        print_line(f"  {'review':9} {one['verdict']} by {by}: {one['why']}")
    if len(part["reviews"]) > REVIEWS_COUNT:
        print_line(f"  {'':9} and {len(part['reviews']) - REVIEWS_COUNT} earlier ones (--json)")
    if part["characteristics"]:
        print_columns(
            ("", "characteristic", "nominal", "lower", "upper", "measured", "U", "verdict", ""),
            map(_characteristic, part["characteristics"]),
        )
    for f in part["findings"]:
        at = ", ".join(num(f[axis]) for axis in ("x_mm", "y_mm", "z_mm"))
        on = " and ".join(f["faces"]) or "no face"
        print_line(
            f"  finding {f['number']}: {f['kind']} on {on}, {num(f['size_mm'])} mm at ({at}) mm, "
            f"view {f['view']}, {f['lamp']}{', ' + f['verdict'] if f['verdict'] else ''}"
            f"{'; a person: ' + f['review'].replace('_', ' ') if f['review'] else ''}"
        )
    if part["steps"]:
        rows = [(s["label"], num(s["actual_s"]), num(s["forecast_s"])) for s in part["steps"]]
        print_columns(("step", "s", "forecast"), rows)
    for r in part["recoveries"]:
        print_line(f"  recovery: {r['fault']}, then {r['action']}: {r['reason']}")
    for a in part["alarms"]:
        print_line(f"  alarm {a['alarm']} ({a['code']}) {a['device']}".rstrip())


def _characteristic(c: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        str(c["balloon"]),
        str(c["label"] or c["id"]),
        *(num(c[key], 3) for key in ("nominal", "lower", "upper", "measured", "U")),
        str(c["verdict"]),
        str(c["reason"]),
    )
