"""Arguments and help of `cellctl history`, `review` and `backup`."""

from pathlib import Path
from typing import Annotated

import typer

from controller.loading import loading

from ..options import JsonOption, RunsOption, StoreOption

# Which parts are listed, and how many.
OfRecipe = Annotated[str, typer.Option(metavar="NAME", help="parts of this recipe")]
OfSerial = Annotated[str, typer.Option(metavar="SERIAL", help="parts of this serial number")]
OfLot = Annotated[str, typer.Option(metavar="LOT", help="parts of this lot")]
OfOperator = Annotated[str, typer.Option(metavar="NAME", help="parts of this operator")]
OfRun = Annotated[str, typer.Option(metavar="RUN", help="parts of runs whose id begins like this")]
Since = Annotated[
    str | None, typer.Option(metavar="DATE", help="parts begun at this date or later (UTC)")
]
Until = Annotated[
    str | None, typer.Option(metavar="DATE", help="parts begun at this date or before (UTC)")
]
Limit = Annotated[
    int, typer.Option(metavar="N", min=1, max=1_000_000, help="how many parts to list")
]


def history(
    part: Annotated[
        str | None,
        typer.Argument(
            metavar="[PART]",
            help="serial number, or RUN/NUMBER, of a part to show with all that is known of it",
        ),
    ] = None,
    recipe: OfRecipe = "",
    verdict: Annotated[
        str,
        typer.Option(
            metavar="VERDICT",
            help="parts of this verdict: pass, fail, indeterminate, no verdict",
        ),
    ] = "",
    serial: OfSerial = "",
    lot: OfLot = "",
    operator: OfOperator = "",
    run: OfRun = "",
    since: Since = None,
    until: Until = None,
    awaiting_review: Annotated[
        bool, typer.Option("--awaiting-review", help="parts that await a person's verdict")
    ] = False,
    reviewed: Annotated[
        bool, typer.Option("--reviewed", help="parts that a person has decided on")
    ] = False,
    limit: Limit = 50,
    export: Annotated[
        Path | None,
        typer.Option(
            "--export",
            metavar="FILE",
            help="write all these parts with their characteristics (.csv, .parquet, .qif)",
        ),
    ] = None,
    refill: Annotated[
        bool,
        typer.Option(
            "--refill", help="fill the store anew from the journals, which are right, first"
        ),
    ] = False,
    drop_pictures_before: Annotated[
        str | None,
        typer.Option(
            "--drop-pictures-before",
            metavar="DATE",
            help="list how much room the pictures of runs take that ended before this date (UTC); "
            "delete them with --yes",
        ),
    ] = None,
    yes: Annotated[
        bool, typer.Option("--yes", help="delete the pictures; verdicts and values stay")
    ] = False,
    store: StoreOption = None,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """List the parts of all runs, newest first, or show one with all that is known of it.

    The list comes from a store that is filled from the journals before each answer; the cell knows
    nothing of it.
    """
    if drop_pictures_before is not None:
        with loading():
            from .keeping import make_room

        raise typer.Exit(make_room(drop_pictures_before, runs, store, is_dry=not yes, as_json=json))
    if yes:
        raise typer.BadParameter("--yes goes with --drop-pictures-before")
    with loading():
        from .answering import Asked, answer

    if awaiting_review and reviewed:
        raise typer.BadParameter("--awaiting-review and --reviewed exclude each other")
    review = "awaiting" if awaiting_review else "reviewed" if reviewed else ""
    asked = Asked(recipe, verdict, serial, lot, operator, run, since, until, review)
    raise typer.Exit(answer(part, asked, limit, export, runs, store, anew=refill, as_json=json))


def review(
    part: Annotated[
        str | None,
        typer.Argument(metavar="[PART]", help="serial number, or RUN/NUMBER, of the part to show"),
    ] = None,
    verdict: Annotated[
        str | None,
        typer.Option(metavar="VERDICT", help="your verdict on PART: accept or reject"),
    ] = None,
    why: Annotated[str, typer.Option(metavar="TEXT", help="the reason; the journal keeps it")] = "",
    who: Annotated[
        str,
        typer.Option(metavar="NAME", help="your name; the journal keeps it (default: the user)"),
    ] = "",
    finding: Annotated[
        list[str] | None,
        typer.Option(
            "--finding",
            metavar="N=WORD",
            help="with --verdict: finding N is `real` or a `false_alarm`; once for each",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            metavar="FILE",
            help="page (HTML) with pictures to write (default: in the run's folder)",
        ),
    ] = None,
    open_: Annotated[
        bool, typer.Option("--open", help="open the page of PART in the browser")
    ] = False,
    all_: Annotated[
        bool, typer.Option("--all", help="list parts that a person has decided on, too")
    ] = False,
    recipe: OfRecipe = "",
    serial: OfSerial = "",
    lot: OfLot = "",
    operator: OfOperator = "",
    run: OfRun = "",
    since: Since = None,
    until: Until = None,
    limit: Limit = 50,
    store: StoreOption = None,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """List the parts that await a person, show one with its findings, or take a verdict on it.

    The verdict becomes a row of the journal, beside the machine's, whether or not the cell runs.
    A later one stands in its place; nothing is deleted.
    """
    with loading():
        from .answering import Asked
        from .reviewing import Order, review_parts

    asked = Asked(
        recipe=recipe,
        serial=serial,
        lot=lot,
        operator=operator,
        run=run,
        since=since,
        until=until,
    )
    order = Order(part, verdict, why, who, tuple(finding or ()), output, open_, all_)
    raise typer.Exit(review_parts(order, asked, limit, runs, store, as_json=json))


def backup(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="backup to write (.tar, .tar.gz), or to restore")
    ],
    restore: Annotated[
        bool, typer.Option("--restore", help="restore FILE to the folder of --runs, new or empty")
    ] = False,
    pictures: Annotated[
        bool, typer.Option("--pictures/--no-pictures", help="pictures of the runs, too")
    ] = True,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Back up a folder of runs: journals, reports, store, pictures; or restore a backup.

    Each file is verified by its SHA-256. A cell may run meanwhile.
    """
    with loading():
        from .keeping import read_backup, write_backup

    if restore:
        raise typer.Exit(read_backup(file, runs, as_json=json))
    raise typer.Exit(write_backup(file, runs, with_pictures=pictures, as_json=json))
