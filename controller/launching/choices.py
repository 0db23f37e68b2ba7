"""Choices for a run: the recipes and cell files of a project, and those shipped."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

from controller.config import ConfigError, load_cell, load_recipe
from controller.config.files import read_text
from controller.config.shipped import SHIPPED, shipped_recipes

FILE_MAX_COUNT: Final = 200  # largest number of files read in a folder
FOLDERS: Final = (".", "recipes", "cells")
IS_RECIPE: Final = re.compile(r"^part\s*:", re.MULTILINE)
IS_CELL: Final = re.compile(r"^devices\s*:", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class RecipeChoice:
    """A recipe available for a run.

    Attributes
    ----------
    key : name on the command line, from the project's folder
    name : name of the product
    part : its CAD file
    count : parts of a run unless another number is given
    emulated : kinds of devices that its cell file has emulated
    problem : reason why it cannot be used, empty if it can
    """

    key: str
    name: str
    part: str = ""
    count: int = 1
    emulated: tuple[str, ...] = ()
    problem: str = ""


@dataclass(frozen=True, slots=True)
class CellChoice:
    """A cell file available in place of the recipe's own.

    Attributes
    ----------
    key : name on the command line, from the project's folder
    emulated, real : its devices
    problem : reason why it cannot be used, empty if it can
    """

    key: str
    emulated: tuple[str, ...] = ()
    real: tuple[str, ...] = ()
    problem: str = ""


@dataclass(frozen=True, slots=True)
class Choices:
    """All choices for a run."""

    recipes: tuple[RecipeChoice, ...]
    cells: tuple[CellChoice, ...]

    def recipe(self, key: str) -> RecipeChoice | None:
        """Return the recipe of a key."""
        return next((one for one in self.recipes if one.key == key), None)

    def cell(self, key: str) -> CellChoice | None:
        """Return the cell file of a key."""
        return next((one for one in self.cells if one.key == key), None)


def choices_of(project_dir: Path) -> Choices:
    """Return the choices for a run in a project, read anew."""
    recipes: list[RecipeChoice] = []
    cells: list[CellChoice] = []
    emulated_in = cache(_emulated_in)  # most recipes of a project share a cell file
    for path in _files(project_dir):
        key = path.relative_to(project_dir).as_posix()
        try:
            text = read_text(path, "a recipe")
        except ConfigError:
            continue
        if IS_RECIPE.search(text):
            recipes.append(_recipe(key, path, emulated_in))
        elif IS_CELL.search(text):
            cells.append(_cell(key, path))
    shipped = (_recipe(one, SHIPPED / f"{one}.yaml", emulated_in) for one in shipped_recipes())
    return Choices((*recipes, *shipped), tuple(cells))


def _files(project_dir: Path) -> Iterator[Path]:
    for name in FOLDERS:
        folder = project_dir if name == "." else project_dir / name
        # `=` stands between a recipe and its number of parts
        yield from [one for one in sorted(folder.glob("*.yaml")) if "=" not in one.name][
            :FILE_MAX_COUNT
        ]


def _emulated_in(cell: Path) -> tuple[str, ...]:
    return tuple(load_cell(cell).emulated_devices)


def _recipe(key: str, path: Path, emulated_in: Callable[[Path], tuple[str, ...]]) -> RecipeChoice:
    try:
        recipe = load_recipe(path)
        emulated = emulated_in(recipe.cell)
    except ConfigError as error:
        return RecipeChoice(key, key, problem=str(error))
    return RecipeChoice(key, recipe.name, recipe.part.name, recipe.count, emulated)


def _cell(key: str, path: Path) -> CellChoice:
    try:
        cell = load_cell(path)
    except ConfigError as error:
        return CellChoice(key, problem=str(error))
    every: dict[str, Any] = cell.devices.model_dump(exclude_none=True)
    emulated = tuple(cell.emulated_devices)
    return CellChoice(key, emulated, tuple(name for name in every if name not in emulated))
