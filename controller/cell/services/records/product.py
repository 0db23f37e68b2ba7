"""One product of the batch: its recipe, its count, and the services for its parts."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from controller.cad.compiled import part_name
from controller.cell.compute import Compute
from controller.cell.machine import Budgets, FaultPolicy
from controller.config import Recipe

INPUTS: Final = "inputs"  # folder of a run for the files it was started with
RECIPE_COPY: Final = "recipe.yaml"  # the recipe in that folder


def inputs_of(number: int) -> Path:
    """Return the folder in a run's own for the files of one of its recipes.

    Parameters
    ----------
    number : number of the recipe in its order, from 0
    """
    return Path(INPUTS) if number == 0 else Path(INPUTS) / f"{number + 1}"


@dataclass(frozen=True, slots=True, eq=False)
class BatchProduct:
    """One product of the batch.

    Attributes
    ----------
    number : in the order, from 0
    recipe : its tolerances, how it is held, what is done about faults
    count : parts that were ordered
    compute : the compute service for parts of this recipe
    policy : about faults, of the cell and the recipe
    budgets : budgets learned in the batch for the grasps and views of its parts
    ahead : the same service by a worker process that nothing waits for; None for none
    """

    number: int
    recipe: Recipe
    count: int
    compute: Compute
    policy: FaultPolicy
    budgets: Budgets
    ahead: Compute | None = None

    @property
    def part_name(self) -> str:
        """The part's name in recognition."""
        return part_name(self.recipe.part)

    @property
    def inputs(self) -> Path:
        """Folder in the run's own for the files of its recipe."""
        return inputs_of(self.number)
