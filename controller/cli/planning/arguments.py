"""The command line of `cellctl plan`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from ..options import DrawingsOption, JobsOption, JsonOption, UnitOption


@dataclass(frozen=True, slots=True, kw_only=True)
class PartPlanOptions:
    """The command line of `cellctl plan`; what each option is stands in its help."""

    parts: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="PART", help="CAD file; several with --site (default: the recipe's part)"
        ),
    ] = None
    recipes: Annotated[
        list[Path] | None,
        typer.Option(
            "--recipe",
            metavar="RECIPE",
            help="recipe (YAML, or a name as in `run`) with density, grasp and views; may be "
            "repeated with --site (default without a CAD file: recipe.yaml in this folder)",
        ),
    ] = None
    cell_path: Annotated[
        Path | None,
        typer.Option(
            "--cell",
            metavar="FILE",
            help="cell file (YAML) (default: the recipe's, else the emulated cell)",
        ),
    ] = None
    pose_index: Annotated[
        int | None,
        typer.Option(
            "--pose", metavar="N", help="stable pose to plan for, by index (default: all)"
        ),
    ] = None
    at: Annotated[
        str | None,
        typer.Option(
            "--at",
            metavar="X,Y,THETA_DEG",
            help="pose on the table (default: the middle of the drop area)",
        ),
    ] = None
    report: Annotated[
        Path | None,
        typer.Option("--report", metavar="FILE", help="page to write (HTML), with every step"),
    ] = None
    drawings: DrawingsOption = None
    unit: UnitOption = None
    is_site_search: Annotated[
        bool,
        typer.Option("--site", help="compute the best places for camera and fixed gripper"),
    ] = False
    without_cache: Annotated[
        bool, typer.Option("--no-cache", help="plan afresh, without the cache")
    ] = False
    jobs: JobsOption = None
    as_json: JsonOption = False
