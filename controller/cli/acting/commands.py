"""Arguments and help of the commands that act on a running cell."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from ..options import CellOption, JsonOption, RunsOption

WhoOption = Annotated[
    str,
    typer.Option("--who", metavar="NAME", help="your name, added to the user name; journaled"),
]
WhyOption = Annotated[str, typer.Option("--why", metavar="TEXT", help="the reason; journaled")]
RUNS = Path("runs")


class Kind(StrEnum):
    """When a pause begins."""

    STEP = "step"
    SAFE = "safe"
    NOW = "now"


def status(runs: RunsOption = RUNS, json: JsonOption = False) -> None:
    """Show the state of the running cell and what it waits for."""
    from .orders import show_status

    raise typer.Exit(show_status(runs, as_json=json))


def watch(runs: RunsOption = RUNS, json: JsonOption = False) -> None:
    """Show the running cell, line by line, until its run ends."""
    from .watching import watch_cell

    raise typer.Exit(watch_cell(runs, as_json=json))


def pause(
    kind: Annotated[
        Kind,
        typer.Argument(
            metavar="WHEN",
            help="`step`: after this step; `safe`: at the next safe point; `now`: at once",
        ),
    ] = Kind.SAFE,
    who: WhoOption = "",
    why: WhyOption = "",
    runs: RunsOption = RUNS,
    json: JsonOption = False,
) -> None:
    """Pause the running cell; the grippers keep what they hold."""
    from .orders import pause_cell

    raise typer.Exit(pause_cell(runs, kind.value, who, why, as_json=json))


def resume(
    yes: Annotated[
        bool, typer.Option("--yes", help="do not ask whether the first motion is right")
    ] = False,
    who: WhoOption = "",
    why: WhyOption = "",
    runs: RunsOption = RUNS,
    json: JsonOption = False,
) -> None:
    """Continue after a pause; shows the first motion before."""
    from .orders import resume_cell

    raise typer.Exit(resume_cell(runs, who, why, is_confirmed=yes, as_json=json))


def step(
    who: WhoOption = "", why: WhyOption = "", runs: RunsOption = RUNS, json: JsonOption = False
) -> None:
    """Do one step of the plan, then pause."""
    from .orders import order_plainly

    raise typer.Exit(order_plainly(runs, "step", who, why, as_json=json))


def stop(
    who: WhoOption = "", why: WhyOption = "", runs: RunsOption = RUNS, json: JsonOption = False
) -> None:
    """Stop all devices on a ramp and end the run.

    The grippers keep holding.
    """
    from .orders import order_plainly

    raise typer.Exit(order_plainly(runs, "stop", who, why, as_json=json))


def abort(
    who: WhoOption = "", why: WhyOption = "", runs: RunsOption = RUNS, json: JsonOption = False
) -> None:
    """Stop all devices at once and end the run.

    The grippers keep holding.
    """
    from .orders import order_plainly

    raise typer.Exit(order_plainly(runs, "abort", who, why, as_json=json))


def ack(
    why: Annotated[
        str,
        typer.Option("--why", metavar="TEXT", help="the reason; journaled"),
    ],
    who: WhoOption = "",
    cell: CellOption = None,
    runs: RunsOption = RUNS,
    json: JsonOption = False,
) -> None:
    """Acknowledge an emergency stop or an opened door.

    It bars the next start, or holds the run, until then.
    """
    from ..inputs.cell_files import cell_of_this_folder
    from .acknowledgement import acknowledge_stop

    raise typer.Exit(acknowledge_stop(cell or cell_of_this_folder(), runs, who, why, as_json=json))


def answer(
    key: Annotated[
        str, typer.Argument(metavar="ANSWER", help="one of the answers that `cellctl status` lists")
    ],
    number: Annotated[
        int | None,
        typer.Option("--number", metavar="N", min=1, help="number of the question that you answer"),
    ] = None,
    who: WhoOption = "",
    why: WhyOption = "",
    runs: RunsOption = RUNS,
    json: JsonOption = False,
) -> None:
    """Answer the question that the running cell asks.

    The first answer counts, whether it comes from here, the page or the run's own terminal.
    """
    from .orders import answer_question

    raise typer.Exit(answer_question(runs, key, number, who, why, as_json=json))
