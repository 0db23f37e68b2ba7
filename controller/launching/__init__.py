"""Starts runs for somebody who is not at a terminal: a person at the page, or a plant system."""

from .choices import CellChoice, Choices, RecipeChoice, choices_of
from .launcher import CELLCTL, LAST_NAME, LOG_FOLDER, Launcher, LaunchRefusedError
from .request import CountedRecipe, RunRequest

__all__ = [
    "CELLCTL",
    "LAST_NAME",
    "LOG_FOLDER",
    "CellChoice",
    "Choices",
    "CountedRecipe",
    "LaunchRefusedError",
    "Launcher",
    "RecipeChoice",
    "RunRequest",
    "choices_of",
]
