"""`cellctl run`: what it takes."""

from pathlib import Path
from typing import Annotated

import typer

from .options import (
    ControlOption,
    EmulatedAtOption,
    EmulatedPoseOption,
    JsonOption,
    RecipeArg,
    RecipeCellOption,
    RunsOption,
    SeedOption,
    SpeedOption,
)

EXAMPLE = "cellctl run featuretype --speed 10"
MAX_PART_COUNT = 100_000  # of one run, as in a recipe


def run(
    recipe: RecipeArg = None,
    cell: RecipeCellOption = None,
    count: Annotated[
        int | None,
        typer.Option(
            "--count", min=1, max=MAX_PART_COUNT, help="number of parts (default: the recipe's)"
        ),
    ] = None,
    speed: SpeedOption = 1.0,
    seed: SeedOption = None,
    lay: Annotated[
        list[Path] | None,
        typer.Option(
            "--lay",
            help="CAD file of a part to put on the emulated table; may be repeated "
            "(default: the recipe's part)",
        ),
    ] = None,
    empty: Annotated[bool, typer.Option("--empty", help="leave the emulated table empty")] = False,
    pose: EmulatedPoseOption = None,
    at: EmulatedAtOption = None,
    control: ControlOption = None,
    part_removed: Annotated[
        bool,
        typer.Option(
            "--part-removed",
            help="state that you took the part out of the grippers; the journal keeps it",
        ),
    ] = False,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="log to stderr")] = False,
) -> None:
    """Inspect and sort parts: the main job. Emulated devices start beside it."""
    from controller.config import find_recipe

    from ..running.recipe_run import quiet_logs, run_recipe
    from ..terminal.output import warn

    quiet_logs(verbose=verbose)
    recipe_file = find_recipe(recipe)
    if recipe is None:
        warn(f"recipe: {recipe_file}")
    code = run_recipe(
        recipe_file,
        cell,
        count=count,
        speed=speed,
        seed=seed,
        lay=tuple(lay or ()),
        empty=empty,
        pose=pose,
        at=at,
        control=control,
        runs_dir=runs,
        is_part_removed=part_removed,
        as_json=json,
    )
    raise typer.Exit(code)
