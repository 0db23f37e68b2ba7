"""The recipes that a person finds at the page: those of the project, and those that come along."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from controller.config import (
    SHIPPED,
    ConfigError,
    Recipe,
    is_cell_file,
    load_recipe,
    split_cad,
    yaml_tree,
)
from controller.config.files import MAX_TEXT_BYTES, read_bytes

MAX_RECIPE_COUNT: Final = 300
OWN, SHIPPED_TOO = "project", "shipped"


@dataclass(frozen=True, slots=True)
class RecipeFile:
    """A recipe's file.

    Attributes
    ----------
    group : `project`, or `shipped` for one that comes with cellctl and is not written to
    path : the file
    """

    group: str
    path: Path

    @property
    def key(self) -> str:
        """Its name at the page."""
        return f"{self.group}/{self.path.stem}"

    @property
    def is_own(self) -> bool:
        """Whether it belongs to the project, and may be written to."""
        return self.group == OWN

    def short(self, error: ConfigError) -> str:
        """Return a message without the folder of the file."""
        return str(error).replace(f"{self.path.parent}/", "")

    def read(self) -> bytes:
        """Return its bytes.

        Raises
        ------
        ConfigError : it cannot be read
        """
        return read_bytes(self.path, MAX_TEXT_BYTES, "a recipe")


@dataclass(frozen=True, slots=True)
class ReadRecipe:
    """A recipe as it was read.

    Attributes
    ----------
    recipe : None where the file is wrong
    problem : reason with file, without its folder, and line; empty where there is none
    sha256 : SHA-256 of its bytes
    mark : changes with the recipe, and with the files that it names
    """

    file: RecipeFile
    recipe: Recipe | None
    problem: str
    sha256: str
    mark: str


class RecipeFolder:
    """The recipes of a project.

    Parameters
    ----------
    own : folder of the project
    shipped : folder of those that come with cellctl
    """

    def __init__(self, own: Path, shipped: Path = SHIPPED) -> None:
        self.own = own
        self._shipped = shipped

    def files(self) -> Sequence[RecipeFile]:
        """Return all recipes: those of the project, then those that come with cellctl."""
        found = [RecipeFile(OWN, path) for path in _recipes_in(self.own)]
        if self.own.resolve() != self._shipped.resolve():
            found += [RecipeFile(SHIPPED_TOO, path) for path in _recipes_in(self._shipped)]
        return found

    def find(self, key: str) -> RecipeFile | None:
        """Return a recipe by its key, None if there is none; no other file can be named."""
        return next((one for one in self.files() if one.key == key), None)


def read_recipe(file: RecipeFile) -> ReadRecipe:
    """Return a recipe in its present state, or its error."""
    try:
        data = file.read()
    except ConfigError as error:
        return ReadRecipe(file, None, file.short(error), "", "")
    sha256 = hashlib.sha256(data).hexdigest()
    try:
        recipe = load_recipe(file.path)
    except ConfigError as error:
        return ReadRecipe(file, None, file.short(error), sha256, sha256)
    stamps = [_stamp(split_cad(path).file) for path in (recipe.part, *recipe.others, recipe.cell)]
    mark = hashlib.sha256("\n".join([sha256, *stamps]).encode()).hexdigest()
    return ReadRecipe(file, recipe, "", sha256, mark)


def _recipes_in(folder: Path) -> list[Path]:
    """Return the files of a folder that are, or should be, recipes."""
    try:
        names = sorted(folder.glob("*.yaml"))[:MAX_RECIPE_COUNT]
    except OSError:
        return []
    return [path for path in names if not path.name.startswith(".") and _is_meant(path)]


def _is_meant(path: Path) -> bool:
    if path.name.lower().endswith(".csg.yaml"):
        return False
    try:
        tree = yaml_tree(path)
    except ConfigError:
        return path.is_file()  # a person finds out here what is wrong with it
    return not is_cell_file(tree) and "part" in tree


def _stamp(path: Path) -> str:
    try:
        status = path.stat()
    except OSError:
        return f"{path}: not there"
    return f"{path}: {status.st_size}, {status.st_mtime_ns}"
