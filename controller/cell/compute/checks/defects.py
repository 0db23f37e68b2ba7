"""Check whether a cell can find defects as small as the recipe requires."""

from math import ceil

from controller.config import Cell, Recipe
from controller.inspection import least_mm
from controller.setup.characteristics import station_of
from messages import say


def check_defects(recipe: Recipe, cell: Cell) -> tuple[str, ...]:
    """Return a sentence for each kind of defect that is requested smaller than the cell can find.

    Parameters
    ----------
    recipe, cell : recipe and cell in question
    """
    mm_per_px = station_of(cell).mm_per_px
    least = {kind: least_mm(kind, mm_per_px) for kind in recipe.inspection.find}
    return tuple(
        say(
            "`inspection.find`: {kind} of {asked:g} mm is smaller than this "
            "cell can find: with {um_per_px:.0f} um a pixel it finds "
            "{least_mm:.2f} mm, on a spotless surface seen square; ask for that or "
            "more, or use a camera with smaller pixels",
            kind=kind,
            asked=asked,
            um_per_px=1000 * mm_per_px,
            least_mm=ceil(100 * least[kind]) / 100,
        )
        for kind, asked in recipe.inspection.find.items()
        if asked < least[kind]
    )
