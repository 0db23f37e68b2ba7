"""Check whether a cell can verify the characteristics of a recipe."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from controller.cad.compiled import CompiledPart
from controller.config import Cell, Recipe
from controller.inspection.characteristics import (
    LEFT_OUT,
    Capability,
    Characteristic,
    capability_of,
    with_capability,
)
from controller.setup.characteristics import build_accuracy, part_characteristics, station_of
from messages import say

UM_PER_MM: Final = 1000.0
RECIPE: Final = "recipe"  # source of limits that a recipe states


@dataclass(frozen=True, slots=True, eq=False)
class CheckedCharacteristic:
    """A characteristic, marked if a PASS does not need it, with the cell's capability for it."""

    characteristic: Characteristic
    capability: Capability


def check_characteristics(
    recipe_path: Path, recipe: Recipe, cell: Cell, part: CompiledPart
) -> tuple[tuple[CheckedCharacteristic, ...], tuple[str, ...]]:
    """Return the measured characteristics of a part, and a sentence for each too tight tolerance.

    General tolerances are never too tight: if the cell cannot verify one, its characteristic is
    marked, and a PASS names it. A tolerance that somebody stated is binding.

    Parameters
    ----------
    recipe_path : for messages
    recipe, cell, part : recipe, cell, and part to measure

    Raises
    ------
    ConfigError : the recipe names what the part does not have
    """
    station, accuracy = station_of(cell), build_accuracy(cell.accuracy)
    asked = part_characteristics(recipe_path, recipe, part)
    checked = tuple(
        CheckedCharacteristic(one, capability_of(one, station, accuracy))
        for one in with_capability(asked, station, accuracy)
    )
    return checked, tuple(problem for each in checked if (problem := _problem(each)))


def _problem(checked: CheckedCharacteristic) -> str:
    """Return the reason why requested limits cannot be verified; empty if they can."""
    one = checked.characteristic
    if one.is_general:
        return ""
    if one.is_measured:
        return "" if checked.capability.is_capable else _too_tight(checked)
    return _not_measured(one) if _is_stated_in_vain(one) else ""


def _is_stated_in_vain(one: Characteristic) -> bool:
    """Return whether a recipe sets limits of an unmeasured characteristic that it keeps."""
    return one.source.startswith(RECIPE) and not one.exempt.startswith(LEFT_OUT)


def _not_measured(one: Characteristic) -> str:
    return say(
        "{id}: {limits} ({source}) cannot be verified, {exempt}; gauge it "
        "elsewhere (`ignore: reason`)",
        id=one.id,
        limits=_limits(one),
        source=one.source,
        exempt=one.exempt,
    )


def _limits(one: Characteristic) -> str:
    if one.is_one_sided:
        return say("up to {upper_mm:g} mm", upper_mm=one.upper_mm)
    return say("{lower_mm:g} to {upper_mm:g} mm", lower_mm=one.lower_mm, upper_mm=one.upper_mm)


def _too_tight(checked: CheckedCharacteristic) -> str:
    one, able = checked.characteristic, checked.capability
    least = able.min_tolerance_mm / 2
    ask = (
        say("{least:.2f} mm", least=least)
        if one.is_one_sided
        else say("+-{least:.2f} mm", least=least)
    )
    return say(
        "{id}: {limits} ({source}) is tighter than this cell can verify: "
        "it promises U = {u_um:.0f} um, which allows {ask} at best; widen "
        "the tolerance, gauge it elsewhere (`ignore: reason`), or use a "
        "camera with smaller pixels",
        id=one.id,
        limits=_limits(one),
        source=one.source,
        u_um=able.U_mm * UM_PER_MM,
        ask=ask,
    )
