"""Read recipe.yaml and cell.yaml once, check all of it, and suggest right keys for wrong ones."""

from .cad_files import CAD_FORMATS, STEP_FORMATS, CadSource, is_cad_file, split_cad
from .calibrations import load_cell
from .cell import EMULATED, Cell
from .errors import ConfigError
from .faults import FaultsSection
from .file_kinds import is_cell_file, is_recipe
from .recipe import Recipe, load_recipe
from .shipped import EMULATED_CELL, SHIPPED, find_recipe, project_recipe
from .yaml_models import Section, line_in, load_yaml, yaml_tree

__all__ = [
    "CAD_FORMATS",
    "EMULATED",
    "EMULATED_CELL",
    "SHIPPED",
    "STEP_FORMATS",
    "CadSource",
    "Cell",
    "ConfigError",
    "FaultsSection",
    "Recipe",
    "Section",
    "find_recipe",
    "is_cad_file",
    "is_cell_file",
    "is_recipe",
    "line_in",
    "load_cell",
    "load_recipe",
    "load_yaml",
    "project_recipe",
    "split_cad",
    "yaml_tree",
]
