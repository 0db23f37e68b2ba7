"""Arguments and help of `cellctl compile`."""

from pathlib import Path
from typing import Annotated

import typer

from controller.loading import loading

from ..options import DrawingsOption, JobsOption, JsonOption, UnitOption, finite


def compile_(
    parts: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="PART",
            help="CAD file; FILE.step#NAME is one body of several (default: the recipe's part)",
        ),
    ] = None,
    recipe: Annotated[
        Path | None,
        typer.Option(
            "--recipe",
            metavar="RECIPE",
            help="recipe (YAML, or a name as in `run`) with cell, density, grasp and views "
            "(default without a CAD file: recipe.yaml in this folder)",
        ),
    ] = None,
    unit: UnitOption = None,
    density: Annotated[
        float | None,
        typer.Option(
            "--density",
            metavar="X",
            min=0.01,
            max=25,
            callback=finite,
            help="density in g/cm3 (default: the CAD file's, else 2.7)",
        ),
    ] = None,
    cell: Annotated[
        Path | None,
        typer.Option("--cell", metavar="FILE", help="cell file (YAML) to plan grasps and views in"),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(
            "--report", metavar="FILE", help="page to write (HTML), with every stable pose"
        ),
    ] = None,
    drawings: DrawingsOption = None,
    no_plans: Annotated[
        bool, typer.Option("--no-plans", help="leave out grasps and plans")
    ] = False,
    characteristics: Annotated[
        bool,
        typer.Option("--characteristics", help="also list the characteristics to measure"),
    ] = False,
    no_cache: Annotated[
        bool, typer.Option("--no-cache", help="compile afresh, without the cache")
    ] = False,
    all_bodies: Annotated[
        bool,
        typer.Option("--all", help="compile each distinct body of a STEP file"),
    ] = False,
    jobs: JobsOption = None,
    json: JsonOption = False,
) -> None:
    """Show what follows from a CAD file: poses, surfaces, edges.

    Prints features, stable poses and outlines too; with a cell, also grasps and plans.
    """
    with loading():
        from ..inputs.ahead import jobs_among
        from ..inputs.part_files import part_files
        from .compiling import compile_parts

    recipes = [recipe] if recipe is not None else []
    files, recipe_cell = part_files(list(parts or ()), recipes, unit and unit.value, cell)
    has_recipe = any(file.recipe is not None for file in files)
    in_cell = recipe_cell if has_recipe else cell
    code = compile_parts(
        files,
        all_bodies=all_bodies,
        density_g_cm3=density,
        report=report,
        drawings=drawings,
        cell=None if no_plans else in_cell,
        use_cache=not no_cache,
        jobs=jobs_among(jobs, use_cache=not no_cache),
        lists_characteristics=characteristics,
        as_json=json,
    )
    raise typer.Exit(code)
