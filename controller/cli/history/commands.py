"""Arguments and help of `cellctl history`, `review`, `rejudge` and `backup`."""

from pathlib import Path
from typing import Annotated

import typer

from controller.loading import loading

from ..options import JobsOption, JsonOption, RunsOption, StoreOption

# Which parts are listed, and how many.
OfRecipe = Annotated[str, typer.Option(metavar="NAME", help="parts of this recipe")]
OfSerial = Annotated[str, typer.Option(metavar="SERIAL", help="parts with this serial number")]
OfLot = Annotated[str, typer.Option(metavar="LOT", help="parts of this lot")]
OfOrder = Annotated[str, typer.Option(metavar="NUMBER", help="parts of the order of this number")]
OfOperator = Annotated[str, typer.Option(metavar="NAME", help="parts of this operator")]
OfRun = Annotated[
    str, typer.Option(metavar="RUN", help="parts of the runs whose id begins with this")
]
OfCell = Annotated[str, typer.Option(metavar="NAME", help="parts of this cell, of several")]
Since = Annotated[
    str | None, typer.Option(metavar="DATE", help="parts begun at this date or later (UTC)")
]
Until = Annotated[
    str | None, typer.Option(metavar="DATE", help="parts begun at this date or before (UTC)")
]
Limit = Annotated[int, typer.Option(metavar="N", min=1, max=1_000_000, help="most parts to list")]


def history(
    part: Annotated[
        str | None,
        typer.Argument(
            metavar="PART",
            help="part to show in full, by serial number, RUN/NUMBER or CELL/RUN/NUMBER",
        ),
    ] = None,
    recipe: OfRecipe = "",
    verdict: Annotated[
        str,
        typer.Option(
            metavar="VERDICT",
            help="parts with this verdict: pass, fail, indeterminate, no verdict",
        ),
    ] = "",
    serial: OfSerial = "",
    lot: OfLot = "",
    order: OfOrder = "",
    operator: OfOperator = "",
    run: OfRun = "",
    cell_name: OfCell = "",
    since: Since = None,
    until: Until = None,
    awaiting_review: Annotated[
        bool, typer.Option("--awaiting-review", help="parts that await a person's verdict")
    ] = False,
    reviewed: Annotated[
        bool, typer.Option("--reviewed", help="parts with a person's verdict")
    ] = False,
    limit: Limit = 50,
    by: Annotated[
        str | None,
        typer.Option(
            metavar="GROUP",
            help="count these parts instead, as `stats --by`: by day, run, recipe, lot, order, "
            "operator or cell",
        ),
    ] = None,
    export: Annotated[
        Path | None,
        typer.Option(
            "--export",
            metavar="FILE",
            help="write these parts with their characteristics (.csv, .parquet, .qif)",
        ),
    ] = None,
    refill: Annotated[
        bool,
        typer.Option("--refill", help="first rebuild the store from the journals"),
    ] = False,
    drop_pictures_before: Annotated[
        str | None,
        typer.Option(
            "--drop-pictures-before",
            metavar="DATE",
            help="show the size of the pictures of runs that ended before this date (UTC); delete "
            "them with --yes",
        ),
    ] = None,
    yes: Annotated[
        bool, typer.Option("--yes", help="delete the pictures; verdicts and values stay")
    ] = False,
    copy_pictures_to: Annotated[
        str | None,
        typer.Option(
            "--copy-pictures-to",
            metavar="URL",
            help="copy the runs' pictures to a store of objects, as s3://plant/cell-3 or "
            "file:///mnt/share; each is read back and journaled",
        ),
    ] = None,
    keep_pictures: Annotated[
        bool,
        typer.Option(
            "--keep-pictures",
            help="copy the runs' pictures and delete old ones here, as `connect: pictures:` of the "
            "cell file asks",
        ),
    ] = False,
    fetch_pictures: Annotated[
        str | None,
        typer.Option(
            "--fetch-pictures",
            metavar="RUN",
            help="write the missing pictures of a run into its folder again, from their copies",
        ),
    ] = None,
    store: StoreOption = None,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """List the parts of all runs, or show one in full.

    The newest part comes first. The list comes from a store that is filled from the journals
    before each answer.
    """
    if drop_pictures_before is not None:
        with loading():
            from .keeping import make_room

        raise typer.Exit(make_room(drop_pictures_before, runs, store, is_dry=not yes, as_json=json))
    if yes:
        raise typer.BadParameter("--yes requires --drop-pictures-before")
    if copy_pictures_to is not None:
        with loading():
            from .keeping import send_pictures

        raise typer.Exit(send_pictures(copy_pictures_to, runs, as_json=json))
    if keep_pictures:
        with loading():
            from .keeping import keep_as_asked

        raise typer.Exit(keep_as_asked(runs, store, as_json=json))
    if fetch_pictures is not None:
        with loading():
            from .keeping import fetch_pictures as fetch

        raise typer.Exit(fetch(fetch_pictures, runs, as_json=json))
    with loading():
        from .answering import FilterWords, answer

    if awaiting_review and reviewed:
        raise typer.BadParameter("--awaiting-review and --reviewed exclude each other")
    review = "awaiting" if awaiting_review else "reviewed" if reviewed else ""
    asked = FilterWords(
        recipe, verdict, serial, lot, order, operator, run, since, until, review, cell_name
    )
    raise typer.Exit(answer(part, asked, limit, by, export, runs, store, anew=refill, as_json=json))


def review(
    part: Annotated[
        str | None,
        typer.Argument(metavar="PART", help="part to show, by serial number or RUN/NUMBER"),
    ] = None,
    verdict: Annotated[
        str | None,
        typer.Option(metavar="VERDICT", help="your verdict on PART: accept or reject"),
    ] = None,
    why: Annotated[str, typer.Option(metavar="TEXT", help="the reason; journaled")] = "",
    who: Annotated[
        str,
        typer.Option(metavar="NAME", help="your name; journaled (default: the user)"),
    ] = "",
    finding: Annotated[
        list[str] | None,
        typer.Option(
            "--finding",
            metavar="N=WORD",
            help="with --verdict: whether finding N is `real` or a `false_alarm`; may be repeated",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            metavar="FILE",
            help="page to write (HTML), with pictures (default: in the run's folder)",
        ),
    ] = None,
    open_: Annotated[
        bool, typer.Option("--open", help="open the page of PART in the browser")
    ] = False,
    all_: Annotated[
        bool, typer.Option("--all", help="also list parts with a person's verdict")
    ] = False,
    recipe: OfRecipe = "",
    serial: OfSerial = "",
    lot: OfLot = "",
    order: OfOrder = "",
    operator: OfOperator = "",
    run: OfRun = "",
    cell_name: OfCell = "",
    since: Since = None,
    until: Until = None,
    limit: Limit = 50,
    store: StoreOption = None,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """List parts that await a person, or record a verdict.

    Shows picture, prediction and difference of each finding. The verdict becomes a row of the
    journal, beside the machine's. A later verdict replaces it; nothing is deleted.
    """
    with loading():
        from .answering import FilterWords
        from .reviewing import ReviewOptions, review_parts

    asked = FilterWords(
        recipe=recipe,
        serial=serial,
        lot=lot,
        order_number=order,
        operator=operator,
        run=run,
        since=since,
        until=until,
        cell=cell_name,
    )
    decided = ReviewOptions(part, verdict, why, who, tuple(finding or ()), output, open_, all_)
    raise typer.Exit(review_parts(decided, asked, limit, runs, store, as_json=json))


def rejudge(
    recipe: Annotated[
        Path,
        typer.Option(
            "--recipe",
            metavar="RECIPE",
            help="recipe to judge by (YAML, or a name as in `run`); judges the parts of its name",
        ),
    ],
    since: Since = None,
    until: Until = None,
    lot: OfLot = "",
    jobs: JobsOption = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="table of all parts to write (.csv)"),
    ] = None,
    store: StoreOption = None,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Judge an archive anew and list the parts that turned.

    Judges stored pictures, which must be those of the journal. Results go into the store alone; an
    interrupted command goes on where it stopped.
    """
    with loading():
        from .rejudging import rejudge_archive

    raise typer.Exit(
        rejudge_archive(recipe, since, until, lot, jobs, output, runs, store, as_json=json)
    )


def backup(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="backup to write (.tar, .tar.gz) or to restore")
    ],
    restore: Annotated[
        bool, typer.Option("--restore", help="restore FILE to the new or empty folder of --runs")
    ] = False,
    pictures: Annotated[
        bool,
        typer.Option("--pictures/--no-pictures", help="include the pictures of the runs, or not"),
    ] = True,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Back up a folder of runs, or restore a backup.

    Journals, reports, store and pictures, each verified by its SHA-256. The cell may run meanwhile.
    """
    with loading():
        from .keeping import read_backup, write_backup

    if restore:
        raise typer.Exit(read_backup(file, runs, as_json=json))
    raise typer.Exit(write_backup(file, runs, with_pictures=pictures, as_json=json))
