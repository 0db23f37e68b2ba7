"""Recipes and options -> CAD files, how each is compiled, and the cell they are planned in."""

from dataclasses import dataclass
from pathlib import Path

from controller.cad.compiled import CompileOptions, options_among
from controller.config import (
    EMULATED_CELL,
    ConfigError,
    Recipe,
    find_recipe,
    load_recipe,
    project_recipe,
)


@dataclass(frozen=True, slots=True)
class PartFile:
    """A CAD file, how it is compiled, and the recipe it is planned with, if any."""

    path: Path
    options: CompileOptions
    recipe: Recipe | None


def part_files(
    parts: list[Path], recipe_paths: list[Path], unit: str | None, cell_path: Path | None
) -> tuple[list[PartFile], Path]:
    """Return the parts that a command line names, and the cell file.

    CAD files alone are planned with a recipe's defaults; with one recipe, with its values. Several
    recipes name their own parts. With neither, recipe.yaml of the working directory is used.

    Parameters
    ----------
    parts : CAD files
    recipe_paths : recipe files, or names of recipes that come with cellctl
    unit : of CAD files that name none
    cell_path : cell file, None for the recipe's

    Raises
    ------
    ConfigError : a recipe is wrong, options contradict each other, or there is no part
    """
    if not parts and not recipe_paths and unit is None and (here := project_recipe()) is not None:
        recipe_paths = [here]
    recipes = [load_recipe(find_recipe(path)) for path in recipe_paths]
    if recipes and unit is not None:
        raise ConfigError("--unit is not allowed with --recipe: the recipe has `unit:`")
    if len(recipes) > 1 and parts:
        raise ConfigError(f"{parts[0]}: several recipes name their parts themselves; leave it out")
    if not recipes and not parts:
        raise ConfigError("a CAD file or --recipe is required")
    cells = {recipe.cell.resolve(): recipe.cell for recipe in recipes}
    if cell_path is None and len(cells) > 1:
        names = ", ".join(str(path) for path in cells.values())
        raise ConfigError(f"the recipes name different cells ({names}); choose one with --cell")
    cell = cell_path or next(iter(cells.values()), EMULATED_CELL)
    if parts:
        recipe = recipes[0] if recipes else None
        wanted = unit if recipe is None else recipe.unit
        files = [
            PartFile(path, _options(path, wanted, is_from_recipe=recipe is not None), recipe)
            for path in parts
        ]
        return files, cell
    return [PartFile(r.part, CompileOptions(unit=r.unit), r) for r in recipes], cell


def cell_of_this_folder() -> Path:
    """Return the cell file of the working directory's recipe, else the emulated cell.

    Raises
    ------
    ConfigError : that recipe is wrong
    """
    recipe = project_recipe()
    return EMULATED_CELL if recipe is None else load_recipe(recipe).cell


def _options(path: Path, unit: str | None, *, is_from_recipe: bool) -> CompileOptions:
    """Return what a file is compiled with: a unit on the command line is checked against it."""
    return options_among(path, unit) if is_from_recipe else CompileOptions(unit=unit)
