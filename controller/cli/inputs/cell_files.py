"""The cell file of a command that names none."""

from pathlib import Path

from controller.config import load_recipe
from controller.config.shipped import EMULATED_CELL, project_recipe


def cell_of_this_folder() -> Path:
    """Return the cell file of the working directory's recipe, else the emulated cell.

    Raises
    ------
    ConfigError : the recipe is wrong
    """
    recipe = project_recipe()
    return EMULATED_CELL if recipe is None else load_recipe(recipe).cell
