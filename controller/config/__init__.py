"""recipe.yaml and cell.yaml: read once, checked whole, wrong keys answered with the right ones."""

from ._yaml import ConfigError
from .cell import EMULATED, Cell, load_cell
from .recipe import Recipe, load_recipe

__all__ = ["EMULATED", "Cell", "ConfigError", "Recipe", "load_cell", "load_recipe"]
