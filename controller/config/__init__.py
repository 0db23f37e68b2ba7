"""recipe.yaml and cell.yaml: read once, checked whole, wrong keys answered with the right ones."""

from ._yaml import Section, line_in, load_yaml
from .cad_files import CAD_FORMATS, is_cad_file
from .cell import EMULATED, Cell, load_cell
from .errors import ConfigError
from .recipe import Recipe, load_recipe

__all__ = [
    "CAD_FORMATS",
    "EMULATED",
    "Cell",
    "ConfigError",
    "Recipe",
    "Section",
    "is_cad_file",
    "line_in",
    "load_cell",
    "load_recipe",
    "load_yaml",
]
