"""*Recipes*: a recipe's inspection in three dimensions; tolerances changed; new parts taken in.

`folder.py` finds recipes, `editing.py` changes them, `taking.py` takes in CAD files, `shown.py`
makes what the browser draws from what child processes print (`controller/page/work.py`),
`noting.py` keeps who changed what, `answers.py` answers.
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
