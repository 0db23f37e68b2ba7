"""Recipes and options -> CAD files, their compile options, and the cell they are planned in."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from controller.arrays import FloatArray
from controller.cad import StablePose
from controller.cad.compiled import CompiledPart, CompileOptions, options_among
from controller.cad.reading import is_binary_stl
from controller.config import (
    EMULATED_CELL,
    ConfigError,
    Recipe,
    find_recipe,
    load_recipe,
    project_recipe,
)
from controller.setup.samples import sampled_for

from .checks import require_files


@dataclass(frozen=True, slots=True)
class PartFile:
    """A CAD file, its compile options, and the recipe it is planned with, if any.

    Attributes
    ----------
    path, options : the file, and how it is compiled
    recipe : its values apply to grasps and views
    recipe_path : recipe of the part, if the part is its own
    """

    path: Path
    options: CompileOptions
    recipe: Recipe | None
    recipe_path: Path | None = None


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
    unit : unit of CAD files that name none
    cell_path : cell file, None for the recipe's

    Raises
    ------
    ConfigError : a recipe is wrong, options contradict each other, or there is no part
    """
    if not parts and not recipe_paths and unit is None and (here := project_recipe()) is not None:
        recipe_paths = [here]
    recipe_files = [find_recipe(path) for path in recipe_paths]
    recipes = [load_recipe(path) for path in recipe_files]
    if recipes and unit is not None:
        raise ConfigError("--unit is not allowed with --recipe: the recipe has `unit:`")
    if len(recipes) > 1 and parts:
        raise ConfigError(f"{parts[0]}: recipes name their own parts; leave it out")
    if not recipes and not parts:
        raise ConfigError("a CAD file or --recipe is required")
    require_files(parts)
    cells = {recipe.cell.resolve(): recipe.cell for recipe in recipes}
    if cell_path is None and len(cells) > 1:
        names = ", ".join(str(path) for path in cells.values())
        raise ConfigError(f"the recipes name different cells ({names}); choose one with --cell")
    cell = cell_path or next(iter(cells.values()), EMULATED_CELL)
    if parts:
        recipe = recipes[0] if recipes else None
        wanted = unit if recipe is None else recipe.unit
        files = [PartFile(path, _options(path, wanted, recipe), recipe) for path in parts]
        return files, cell
    own = zip(recipes, recipe_files, strict=True)
    return [
        PartFile(r.part, sampled_for(r, CompileOptions(unit=r.unit)), r, path) for r, path in own
    ], cell


def stable_pose(part: CompiledPart, index: int) -> StablePose:
    """Return the stable pose that ``--pose`` names, by the index that `cellctl compile` lists.

    Raises
    ------
    ConfigError : the part has no such pose
    """
    for pose in part.poses:
        if pose.index == index:
            return pose
    name, known = part.solid.name, sorted(pose.index for pose in part.poses)
    if not known:
        raise ConfigError(f"{name} has no stable pose: it rolls in every pose")
    have = f"poses {known[0]} to {known[-1]}" if len(known) > 1 else f"pose {known[0]} only"
    raise ConfigError(f"--pose {index}: {name} has stable {have} (`cellctl compile` lists them)")


def emulated_orientation(parts: Sequence[CompiledPart], pose: int | None) -> FloatArray | None:
    """Return the rotation CAD -> upright (3, 3) in which the first emulated part rests.

    Parameters
    ----------
    parts : parts on the emulated table, starting with the one for ``--pose``
    pose : index of its stable pose; None leaves it to the emulator's seed

    Raises
    ------
    ConfigError : no part is on the table, or the part has no such pose
    """
    if pose is None:
        return None
    if not parts:
        raise ConfigError(f"--pose {pose}: no part is on the emulated table; leave it out")
    return stable_pose(parts[0], pose).R


def for_emulator(path: Path, part: CompiledPart, folder: Path) -> Path:
    """Return a CAD file that the emulated cell reads as we do: binary STL in millimetres.

    Parameters
    ----------
    path, part : CAD file, and what it holds
    folder : folder for a copy, if the file is not such a one
    """
    if part.solid.unit == "mm" and is_binary_stl(path):
        return path
    folder.mkdir(parents=True, exist_ok=True)
    copy = folder / f"{part.solid.name}.stl"
    part.solid.mesh.export(copy)
    return copy


def _options(path: Path, unit: str | None, recipe: Recipe | None) -> CompileOptions:
    """Return the compile options of a file, after checking a unit given on the command line."""
    if recipe is None:
        return CompileOptions(unit=unit)
    return sampled_for(recipe, options_among(path, unit))
