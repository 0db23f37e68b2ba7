"""The command line of `cellctl compile`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from ..options import DensityOption, DrawingsOption, JobsOption, JsonOption, UnitOption


@dataclass(frozen=True, slots=True, kw_only=True)
class PartsOptions:
    """The command line of `cellctl compile`; what each option is stands in its help."""

    parts: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="PART",
            help="CAD file; FILE.step#NAME is one body of several (default: the recipe's part)",
        ),
    ] = None
    recipe: Annotated[
        Path | None,
        typer.Option(
            "--recipe",
            metavar="RECIPE",
            help="recipe (YAML, or a name as in `run`) with cell, density, grasp and views "
            "(default without a CAD file: recipe.yaml in this folder)",
        ),
    ] = None
    unit: UnitOption = None
    density_g_cm3: DensityOption = None
    cell: Annotated[
        Path | None,
        typer.Option("--cell", metavar="FILE", help="cell file (YAML) to plan grasps and views in"),
    ] = None
    report: Annotated[
        Path | None,
        typer.Option(
            "--report", metavar="FILE", help="page to write (HTML), with every stable pose"
        ),
    ] = None
    drawings: DrawingsOption = None
    without_plans: Annotated[
        bool, typer.Option("--no-plans", help="leave out grasps and plans")
    ] = False
    lists_characteristics: Annotated[
        bool,
        typer.Option("--characteristics", help="also list the characteristics to measure"),
    ] = False
    without_cache: Annotated[
        bool, typer.Option("--no-cache", help="compile afresh, without the cache")
    ] = False
    all_bodies: Annotated[
        bool,
        typer.Option("--all", help="compile each distinct body of a STEP file"),
    ] = False
    jobs: JobsOption = None
    as_json: JsonOption = False
