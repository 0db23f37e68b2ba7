"""The command lines of `cellctl history`, `review` and `rejudge`."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer

from ..options import JobsOption, JsonOption, RunsOption, StoreOption

RecipeFilter = Annotated[str, typer.Option("--recipe", metavar="NAME", help="parts of this recipe")]
LotFilter = Annotated[str, typer.Option("--lot", metavar="LOT", help="parts of this lot")]
SinceFilter = Annotated[
    str | None,
    typer.Option("--since", metavar="DATE", help="parts begun at this date or later (UTC)"),
]
UntilFilter = Annotated[
    str | None,
    typer.Option("--until", metavar="DATE", help="parts begun at this date or before (UTC)"),
]
LimitOption = Annotated[
    int, typer.Option("--limit", metavar="N", min=1, max=1_000_000, help="most parts to list")
]


@dataclass(frozen=True, slots=True, kw_only=True)
class PartFilter:
    """The options that select parts, beside their recipe."""

    serial: Annotated[
        str, typer.Option("--serial", metavar="SERIAL", help="parts with this serial number")
    ] = ""
    lot: LotFilter = ""
    order_number: Annotated[
        str,
        typer.Option("--order", metavar="NUMBER", help="parts of the order of this number"),
    ] = ""
    operator: Annotated[
        str, typer.Option("--operator", metavar="NAME", help="parts of this operator")
    ] = ""
    run: Annotated[
        str,
        typer.Option("--run", metavar="RUN", help="parts of the runs whose id begins with this"),
    ] = ""
    cell: Annotated[
        str, typer.Option("--cell-name", metavar="NAME", help="parts of this cell, of several")
    ] = ""
    since: SinceFilter = None
    until: UntilFilter = None


@dataclass(frozen=True, slots=True, kw_only=True)
class HistoryOptions:
    """The command line of `cellctl history`; what each option is stands in its help."""

    part: Annotated[
        str | None,
        typer.Argument(
            metavar="PART",
            help="part to show in full, by serial number, RUN/NUMBER or CELL/RUN/NUMBER",
        ),
    ] = None
    recipe: RecipeFilter = ""
    verdict: Annotated[
        str,
        typer.Option(
            "--verdict",
            metavar="VERDICT",
            help="parts with this verdict: pass, fail, indeterminate, no verdict",
        ),
    ] = ""
    chosen: PartFilter = field(default_factory=PartFilter)
    awaits_review: Annotated[
        bool, typer.Option("--awaiting-review", help="parts that await a person's verdict")
    ] = False
    is_reviewed: Annotated[
        bool, typer.Option("--reviewed", help="parts with a person's verdict")
    ] = False
    limit: LimitOption = 50
    by: Annotated[
        str | None,
        typer.Option(
            "--by",
            metavar="GROUP",
            help="count these parts instead, as `stats --by`: by day, run, recipe, lot, order, "
            "operator or cell",
        ),
    ] = None
    export: Annotated[
        Path | None,
        typer.Option(
            "--export",
            metavar="FILE",
            help="write these parts with their characteristics (.csv, .parquet, .qif)",
        ),
    ] = None
    is_refilled: Annotated[
        bool, typer.Option("--refill", help="first rebuild the store from the journals")
    ] = False
    drop_pictures_before: Annotated[
        str | None,
        typer.Option(
            "--drop-pictures-before",
            metavar="DATE",
            help="show the size of the pictures of runs that ended before this date (UTC); delete "
            "them with --yes",
        ),
    ] = None
    yes: Annotated[
        bool, typer.Option("--yes", help="delete the pictures; verdicts and values stay")
    ] = False
    copy_pictures_to: Annotated[
        str | None,
        typer.Option(
            "--copy-pictures-to",
            metavar="URL",
            help="copy the runs' pictures to a store of objects, as s3://plant/cell-3 or "
            "file:///mnt/share; each is read back and journaled",
        ),
    ] = None
    keep_pictures: Annotated[
        bool,
        typer.Option(
            "--keep-pictures",
            help="copy the runs' pictures and delete old ones here, as `connect: pictures:` of the "
            "cell file asks",
        ),
    ] = False
    fetch_pictures: Annotated[
        str | None,
        typer.Option(
            "--fetch-pictures",
            metavar="RUN",
            help="write the missing pictures of a run into its folder again, from their copies",
        ),
    ] = None
    store_url: StoreOption = None
    runs_dir: RunsOption = Path("runs")
    as_json: JsonOption = False


@dataclass(frozen=True, slots=True, kw_only=True)
class ReviewOptions:
    """The command line of `cellctl review`; what each option is stands in its help."""

    part: Annotated[
        str | None,
        typer.Argument(metavar="PART", help="part to show, by serial number or RUN/NUMBER"),
    ] = None
    verdict: Annotated[
        str | None,
        typer.Option("--verdict", metavar="VERDICT", help="your verdict on PART: accept or reject"),
    ] = None
    why: Annotated[str, typer.Option("--why", metavar="TEXT", help="the reason; journaled")] = ""
    who: Annotated[
        str,
        typer.Option("--who", metavar="NAME", help="your name; journaled (default: the user)"),
    ] = ""
    findings: Annotated[
        list[str] | None,
        typer.Option(
            "--finding",
            metavar="N=WORD",
            help="with --verdict: whether finding N is `real` or a `false_alarm`; may be repeated",
        ),
    ] = None
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            metavar="FILE",
            help="page to write (HTML), with pictures (default: in the run's folder)",
        ),
    ] = None
    is_opened: Annotated[
        bool, typer.Option("--open", help="open the page of PART in the browser")
    ] = False
    is_all: Annotated[
        bool, typer.Option("--all", help="also list parts with a person's verdict")
    ] = False
    recipe: RecipeFilter = ""
    chosen: PartFilter = field(default_factory=PartFilter)
    limit: LimitOption = 50
    store_url: StoreOption = None
    runs_dir: RunsOption = Path("runs")
    as_json: JsonOption = False


@dataclass(frozen=True, slots=True, kw_only=True)
class RejudgeOptions:
    """The command line of `cellctl rejudge`; what each option is stands in its help."""

    recipe: Annotated[
        Path,
        typer.Option(
            "--recipe",
            metavar="RECIPE",
            help="recipe to judge by (YAML, or a name as in `run`); judges the parts of its name",
        ),
    ]
    since: SinceFilter = None
    until: UntilFilter = None
    lot: LotFilter = ""
    jobs: JobsOption = None
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="table of all parts to write (.csv)"),
    ] = None
    store_url: StoreOption = None
    runs_dir: RunsOption = Path("runs")
    as_json: JsonOption = False
