"""The recipe that judges a set of views."""

from pathlib import Path

from controller.cad.compiled import part_name
from controller.config import ConfigError, find_recipe, load_recipe, split_cad
from controller.config.cad_files import MAX_CAD_BYTES
from controller.config.files import read_bytes
from controller.config.view_set import ViewSetFile
from controller.stored import Judging

from ..terminal.output import warn


def judging_of(
    set_path: Path, file: ViewSetFile, recipe_path: Path | None, learned: Path | None = None
) -> Judging:
    """Return the recipe that judges a set: the one named, else the set's own.

    Parameters
    ----------
    set_path : the set
    file : its content
    recipe_path : a recipe file, or the name of a recipe that comes with cellctl
    learned : file of what good parts look like; None for the recipe's

    Raises
    ------
    ConfigError : the recipe is wrong, or for another part
    """
    if recipe_path is None:
        return Judging(file.recipe, set_path, set_path, learned or file.learned)
    path = find_recipe(recipe_path)
    recipe = load_recipe(path)
    if part_name(recipe.part) != part_name(file.part):
        raise ConfigError(
            f"{path}: `part`: the recipe is for {part_name(recipe.part)}, the set shows "
            f"{part_name(file.part)}; choose the recipe of this part"
        )
    own, other = (
        read_bytes(split_cad(cad).file, MAX_CAD_BYTES, "a CAD file")
        for cad in (recipe.part, file.part)
    )
    if own != other:
        warn(f"{path}: its CAD file differs from {file.part}; the part is judged by the latter")
    return Judging(recipe, path, set_path, learned or recipe.inspection.learned)
