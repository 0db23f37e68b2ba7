"""*Recipes*: a recipe's inspection in three dimensions; tolerances changed; new parts taken in.

`folder.py` finds recipes, `editing.py` changes them, `taking.py` takes in CAD files, `shown.py`
turns the output of child processes (`controller/page/work.py`) into the browser's data, `noting.py`
logs all changes, `answers.py` answers.
"""

from ..frame.screens import Screen, Setting
from ..frame.words import word
from ..work import Workshop
from .answers import RecipeAnswers

__all__ = ["screen"]


def screen(setting: Setting) -> Screen:
    """Return the screen."""
    answers = RecipeAnswers(setting, Workshop())
    return Screen("recipes", word("Recipes"), answers.every, beside=answers.open)
