"""Arguments and help of `cellctl history`, `review`, `rejudge` and `backup`."""

from pathlib import Path
from typing import Annotated

import typer

from controller.loading import loading

from ..options import JsonOption, RunsOption, from_fields
from .arguments import HistoryOptions, RejudgeOptions, ReviewOptions


@from_fields
def history(options: HistoryOptions) -> None:
    """List the parts of all runs, or show one in full.

    The newest part comes first. The list comes from a store that is filled from the journals
    before each answer.
    """
    runs, store, json = options.runs_dir, options.store_url, options.as_json
    if options.drop_pictures_before is not None:
        with loading():
            from .keeping import make_room

        before = options.drop_pictures_before
        raise typer.Exit(make_room(before, runs, store, is_dry=not options.yes, as_json=json))
    if options.yes:
        raise typer.BadParameter("--yes requires --drop-pictures-before")
    if options.copy_pictures_to is not None:
        with loading():
            from .keeping import send_pictures

        raise typer.Exit(send_pictures(options.copy_pictures_to, runs, as_json=json))
    if options.keep_pictures:
        with loading():
            from .keeping import keep_as_asked

        raise typer.Exit(keep_as_asked(runs, store, as_json=json))
    if options.fetch_pictures is not None:
        with loading():
            from .keeping import fetch_pictures

        raise typer.Exit(fetch_pictures(options.fetch_pictures, runs, as_json=json))
    with loading():
        from .answering import answer

    if options.awaits_review and options.is_reviewed:
        raise typer.BadParameter("--awaiting-review and --reviewed exclude each other")
    raise typer.Exit(answer(options))


@from_fields
def review(options: ReviewOptions) -> None:
    """List parts that await a person, or record a verdict.

    Shows picture, prediction and difference of each finding. The verdict becomes a row of the
    journal, beside the machine's. A later verdict replaces it; nothing is deleted.
    """
    with loading():
        from .reviewing import review_parts

    raise typer.Exit(review_parts(options))


@from_fields
def rejudge(options: RejudgeOptions) -> None:
    """Judge an archive anew and list the parts that turned.

    Judges stored pictures, which must be those of the journal. Results go into the store alone; an
    interrupted command goes on where it stopped.
    """
    with loading():
        from .rejudging import rejudge_archive

    raise typer.Exit(rejudge_archive(options))


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
