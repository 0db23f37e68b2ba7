"""Recipes on a command line: each a file or a name, maybe with a count, of different parts."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from controller.cad.compiled import part_name
from controller.cell.batch import OrderedRecipe
from controller.cell.compute import MAX_RECIPE_COUNT
from controller.config import ConfigError, find_recipe, load_recipe

from ..options import MAX_PART_COUNT
from ..terminal.output import warn


@dataclass(frozen=True, slots=True)
class AskedRecipe:
    """A recipe as a command line names it, with its count if one is given."""

    path: Path
    count: int | None = None


def asked_recipes(words: Sequence[str], *, has_counts: bool = True) -> tuple[AskedRecipe, ...]:
    """Return the recipes for words ``RECIPE`` or ``RECIPE=COUNT``; the default if there are none.

    Parameters
    ----------
    words : words of the command line
    has_counts : whether a count may follow a recipe

    Raises
    ------
    ConfigError : a count is none, or a name is of no recipe
    """
    if not words:
        return (AskedRecipe(find_recipe(None)),)
    return tuple(_asked(word, has_counts=has_counts) for word in words)


def recipes_to_run(words: Sequence[str] | None) -> tuple[AskedRecipe, ...]:
    """Return the recipes of a run; without a word the default one, which is named to the person.

    Raises
    ------
    ConfigError : a count is none, or a name is of no recipe
    """
    asked = asked_recipes(words or ())
    if not words:
        warn(f"recipe: {asked[0].path}")
    return asked


def _asked(word: str, *, has_counts: bool) -> AskedRecipe:
    name, mark, tail = word.rpartition("=")
    if not mark or Path(word).exists():
        return AskedRecipe(find_recipe(Path(word)))
    if not has_counts:
        raise ConfigError(f"{word}: no count is allowed here; leave out `={tail}`")
    if not (tail.isascii() and tail.isdigit() and 1 <= int(tail) <= MAX_PART_COUNT):
        raise ConfigError(f"{word}: expected a number of parts after the =, 1 to {MAX_PART_COUNT}")
    return AskedRecipe(find_recipe(Path(name)), int(tail))


def ordered_recipes(
    asked: Sequence[AskedRecipe], count: int | None = None
) -> tuple[OrderedRecipe, ...]:
    """Return the recipes, read, with the number of parts of each.

    Parameters
    ----------
    asked : as the command line names them
    count : number of parts of each that names none; None for the recipe's own

    Raises
    ------
    ConfigError : a recipe is wrong, or two of them cannot be told apart
    """
    if len(asked) > MAX_RECIPE_COUNT:
        raise ConfigError(f"{len(asked)} recipes: a run takes {MAX_RECIPE_COUNT} at most")
    read = [(one, load_recipe(one.path)) for one in asked]
    ordered = tuple(
        OrderedRecipe(one.path, recipe, one.count or count or recipe.count) for one, recipe in read
    )
    require_apart(ordered)
    return ordered


def require_apart(ordered: Sequence[OrderedRecipe]) -> None:
    """Check that recipes are of different parts, by file and by name.

    Raises
    ------
    ConfigError : two of them cannot be told apart
    """
    if len(ordered) < 2:
        return
    parts: dict[Path, Path] = {}
    names: dict[str, Path] = {}
    for one in ordered:
        part = one.recipe.part.resolve()
        if part in parts:
            raise ConfigError(
                f"{parts[part]} and {one.path} are recipes of the same part, {part.name}: a part "
                "on the table fits both; leave one out"
            )
        if one.recipe.name in names:
            raise ConfigError(
                f"{names[one.recipe.name]} and {one.path} have the same name, "
                f"{one.recipe.name}: give one of them another `name:`"
            )
        parts[part], names[one.recipe.name] = one.path, one.path
    called: dict[str, Path] = {}
    for one in ordered:
        for file in (one.recipe.part, *one.recipe.others):
            known = called.setdefault(part_name(file), file.resolve())
            if known != file.resolve():
                raise ConfigError(
                    f"{one.path}: {file} and {known} have the same name, and parts are identified "
                    "by file name; rename one"
                )


def cell_of(ordered: Sequence[OrderedRecipe], cell_path: Path | None) -> Path:
    """Return the cell file of a run: the one given, or that of all its recipes.

    Parameters
    ----------
    ordered : its recipes
    cell_path : as given on the command line, None for the recipes'

    Raises
    ------
    ConfigError : the recipes name different ones
    """
    cells = {one.recipe.cell.resolve(): one.recipe.cell for one in ordered}
    if cell_path is None and len(cells) > 1:
        names = ", ".join(str(path) for path in cells.values())
        raise ConfigError(f"the recipes name different cells ({names}); choose one with --cell")
    return cell_path or next(iter(cells.values()))
