"""recipe.yaml and cell.yaml: read once, checked whole, wrong keys answered with the right ones."""

from ._yaml import line_in
from .cell import EMULATED, Cell, load_cell
from .errors import ConfigError
from .layout import build_lamps, build_layout, panel_corners, table_corners
from .recipe import Recipe, faces_left_out, load_recipe

__all__ = [
    "EMULATED",
    "Cell",
    "ConfigError",
    "Recipe",
    "build_lamps",
    "build_layout",
    "faces_left_out",
    "line_in",
    "load_cell",
    "load_recipe",
    "panel_corners",
    "table_corners",
]
