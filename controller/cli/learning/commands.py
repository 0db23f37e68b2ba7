"""Arguments and help of `cellctl learn`."""

from pathlib import Path
from typing import Annotated

import typer

from controller.loading import loading

from ..options import JobsOption, JsonOption


def learn(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="file to write (.learned)")
    ],
    sets: Annotated[
        list[Path] | None,
        typer.Argument(metavar="SET", help="sets of views of good parts (JSON)"),
    ] = None,
    runs: Annotated[
        Path | None,
        typer.Option("--runs", metavar="FOLDER", help="folder of runs; requires --accepted"),
    ] = None,
    accepted: Annotated[
        bool,
        typer.Option(
            "--accepted", help="take the newest parts that passed or that a person accepted"
        ),
    ] = False,
    recipe: Annotated[
        Path | None,
        typer.Option(
            "--recipe",
            metavar="RECIPE",
            help="recipe (YAML, or a name as in `run`) whose part is learned, with the limits",
        ),
    ] = None,
    jobs: JobsOption = None,
    json: JsonOption = False,
) -> None:
    """Learn what good parts look like.

    Judges each part by the others, prints the result, and leaves out a part that differs from
    them. At least five good parts are needed.
    """
    if bool(sets) == (runs is not None):
        raise typer.BadParameter("name either SET... or --runs")
    if (runs is not None) != accepted:
        raise typer.BadParameter("--runs and --accepted go together")
    with loading():
        from controller.catalogue import jobs_among

        from .learned_parts import learn_parts

    asked = jobs_among(jobs)
    raise typer.Exit(learn_parts(sets or (), runs, recipe, output, asked, as_json=json))
