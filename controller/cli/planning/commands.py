"""Arguments and help of `cellctl check` and `plan`."""

from pathlib import Path
from typing import Annotated

import typer

from controller.loading import loading

from ..options import (
    DrawingsOption,
    JobsOption,
    JsonOption,
    RecipeCellOption,
    RecipesArg,
    UnitOption,
)


def check(
    recipes: RecipesArg = None, cell: RecipeCellOption = None, json: JsonOption = False
) -> None:
    """Check recipe, cell file and CAD file; nothing moves.

    Plans every likely stable pose of the part, forecasts which share of its surface will be
    compared, and states which dimensions the cell can verify. Several recipes are checked as for
    one run with all of them.
    """
    with loading():
        from ..inputs.recipes import asked_recipes
        from .recipe_check import check_recipes

    asked = asked_recipes(recipes or (), has_counts=False)
    raise typer.Exit(check_recipes(asked, cell, as_json=json))


def plan(
    parts: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="PART", help="CAD file; several with --site (default: the recipe's part)"
        ),
    ] = None,
    recipe: Annotated[
        list[Path] | None,
        typer.Option(
            "--recipe",
            metavar="RECIPE",
            help="recipe (YAML, or a name as in `run`) with density, grasp and views; may be "
            "repeated with --site (default without a CAD file: recipe.yaml in this folder)",
        ),
    ] = None,
    cell: Annotated[
        Path | None,
        typer.Option(
            "--cell",
            metavar="FILE",
            help="cell file (YAML) (default: the recipe's, else the emulated cell)",
        ),
    ] = None,
    pose: Annotated[
        int | None,
        typer.Option(
            "--pose", metavar="N", help="stable pose to plan for, by index (default: all)"
        ),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            "--at",
            metavar="X,Y,THETA_DEG",
            help="pose on the table (default: the middle of the drop area)",
        ),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option("--report", metavar="FILE", help="page to write (HTML), with every step"),
    ] = None,
    drawings: DrawingsOption = None,
    unit: UnitOption = None,
    site: Annotated[
        bool,
        typer.Option("--site", help="compute the best places for camera and fixed gripper"),
    ] = False,
    no_cache: Annotated[
        bool, typer.Option("--no-cache", help="plan afresh, without the cache")
    ] = False,
    jobs: JobsOption = None,
    json: JsonOption = False,
) -> None:
    """Plan how to present a part to the inspection camera.

    Prints steps, forecast and coverage for every stable pose, and why the rest of the surface is
    not covered.
    """
    with loading():
        from controller.config import ConfigError

        from ..inputs.ahead import jobs_among
        from ..inputs.part_files import part_files

    files, cell_file = part_files(list(parts or ()), list(recipe or ()), unit and unit.value, cell)
    if site:
        given = {"--pose": pose, "--at": at, "--report": report, "--jobs": jobs}
        given["--drawings"] = drawings
        for name, value in given.items():
            if value is not None:
                raise ConfigError(f"--site cannot be combined with {name}")
        with loading():
            from .site import site_parts

        code = site_parts(files, cell_file, use_cache=not no_cache, as_json=json)
        raise typer.Exit(code)
    if len(files) > 1:
        second = files[1].path
        raise ConfigError(f"{second}: `plan` takes one part; only --site takes several")
    with loading():
        from .part_plan import plan_part_file

    code = plan_part_file(
        files[0],
        cell_file,
        pose,
        at,
        report=report,
        drawings=drawings,
        use_cache=not no_cache,
        jobs=jobs_among(jobs, use_cache=not no_cache),
        as_json=json,
    )
    raise typer.Exit(code)
