"""`cellctl check`: what it takes."""

import typer

from .options import JsonOption, RecipeArg, RecipeCellOption

EXAMPLE = "cellctl check flange_xy"


def check(
    recipe: RecipeArg = None, cell: RecipeCellOption = None, json: JsonOption = False
) -> None:
    """Check all that can be wrong before anything moves.

    Files, CAD, grasps, views, reach: for every likely stable pose of the recipe's part.
    """
    from controller.config import find_recipe

    from ..planning.recipe_check import check_recipe

    raise typer.Exit(check_recipe(find_recipe(recipe), cell, as_json=json))
