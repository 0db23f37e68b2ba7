"""Sample density of a part: one function for every command that counts coverage."""

from dataclasses import replace

from controller.cad.compiled import CompileOptions, spacing_for
from controller.config import Recipe


def sampled_for(recipe: Recipe | None, options: CompileOptions) -> CompileOptions:
    """Return compile options with samples as dense as a recipe's smallest defect requires.

    Parameters
    ----------
    recipe : with the smallest defect to be found; None for a recipe's default
    options : options of the part
    """
    if recipe is None:
        return options
    spacing_mm = spacing_for(recipe.inspection.smallest_defect_mm)
    return replace(options, sample_spacing_mm=spacing_mm)
