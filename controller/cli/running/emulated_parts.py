"""The parts on the emulated table, and the number of times each is brought again."""

from collections.abc import Sequence
from pathlib import Path

from controller.cad.compiled import CompiledPart, load_part, options_among
from controller.cell.batch import OrderedRecipe
from controller.cell.compute import load_parts


def parts_on_table(
    ordered: Sequence[OrderedRecipe], lay: Sequence[Path], *, is_empty: bool
) -> list[tuple[Path, CompiledPart]]:
    """Return the CAD files on the emulated table, each with its part: by default one per recipe.

    Parameters
    ----------
    ordered : the recipes of the run
    lay : CAD files given on the command line
    is_empty : True if nothing lies there

    Raises
    ------
    CadError : a CAD file is wrong
    """
    own = [(one.recipe.part, load_parts(one.recipe)[0]) for one in ordered]
    if is_empty:
        return []
    unit = ordered[0].recipe.unit
    return [(path, load_part(path, options_among(path, unit))) for path in lay] or own


def feeding(
    ordered: Sequence[OrderedRecipe], parts: Sequence[Path], on_table: int | None
) -> tuple[str, ...]:
    """Return the emulator's options to bring parts until each recipe has as many as ordered.

    Of a recipe whose own file is not among the parts there nothing is brought, unless the recipe is
    the only one: then the first part is brought again.

    Parameters
    ----------
    ordered : the recipes of the run
    parts : CAD files on the emulated table
    on_table : parts there at a time, None for all of them
    """
    counts = [0] * len(parts)
    if len(ordered) == 1:
        counts[0] = max(ordered[0].count - len(parts), 0)
    else:
        files = [path.resolve() for path in parts]
        for one in ordered:
            own = [k for k, file in enumerate(files) if file == one.recipe.part.resolve()]
            if own:
                counts[own[0]] = max(one.count - len(own), 0)
    fed = ("--feed", ",".join(map(str, counts))) if any(counts) else ()
    return (*fed, *(() if on_table is None else ("--on-table", str(on_table))))
