"""Arguments and help of `cellctl check` and `plan`."""

import typer

from controller.loading import loading

from ..options import (
    JsonOption,
    RecipeCellOption,
    RecipesArg,
    from_fields,
)
from .arguments import PartPlanOptions


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


@from_fields
def plan(options: PartPlanOptions) -> None:
    """Plan how to present a part to the inspection camera.

    Prints steps, forecast and coverage for every stable pose, and why the rest of the surface is
    not covered.
    """
    with loading():
        from controller.config import ConfigError

        from ..inputs.part_files import part_files

    unit = options.unit and options.unit.value
    files, cell_file = part_files(
        list(options.parts or ()), list(options.recipes or ()), unit, options.cell_path
    )
    if options.is_site_search:
        given = {
            "--pose": options.pose_index,
            "--at": options.at,
            "--report": options.report,
            "--jobs": options.jobs,
            "--drawings": options.drawings,
        }
        for name, value in given.items():
            if value is not None:
                raise ConfigError(f"--site cannot be combined with {name}")
        with loading():
            from .site import site_parts

        code = site_parts(
            files, cell_file, use_cache=not options.without_cache, as_json=options.as_json
        )
        raise typer.Exit(code)
    if len(files) > 1:
        second = files[1].path
        raise ConfigError(f"{second}: `plan` takes one part; only --site takes several")
    with loading():
        from .part_plan import plan_part_file

    raise typer.Exit(plan_part_file(options, files[0], cell_file))
