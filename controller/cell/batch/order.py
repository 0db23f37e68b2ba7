"""The order of a run: recipe, cell, number of parts, and their papers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from controller.config import Cell, Recipe

from ..compute import Job
from ..devices.clocks import FoundClock
from ..services.table import Label, LabelOrder


@dataclass(frozen=True, slots=True)
class Papers:
    """The papers of the parts, as the operator gives them; an empty text is unknown.

    Attributes
    ----------
    serials : serials of the parts, in the order they are worked on
    part_temperature_c : None if nobody measured it
    listed : label of each part of a list, with the number of its recipe
    counted_from : first of the serial numbers that are counted up; empty if none are
    is_read : serial numbers are read off the parts
    order_number : number of the order for the parts
    """

    operator: str = ""
    lot: str = ""
    serials: tuple[str, ...] = ()
    part_temperature_c: float | None = None
    listed: tuple[tuple[int, Label], ...] = ()
    counted_from: str = ""
    is_read: bool = False
    order_number: str = ""

    @property
    def numbers(self) -> LabelOrder:
        """The source of the serial numbers."""
        return LabelOrder(self.serials, self.listed, self.counted_from, self.is_read)


NO_PAPERS: Final = Papers()


@dataclass(frozen=True, slots=True)
class OrderedRecipe:
    """One recipe of an order: its file, its content when read, and the number of parts."""

    path: Path
    recipe: Recipe
    count: int


# What a start does where an earlier run may have left a part in a gripper: refuse; have the
# operator decide on a proposal; go on by itself where the proposal is proven safe.
RecoveryPolicy = Literal["refuse", "ask", "auto"]


def jobs_of(ordered: Sequence[OrderedRecipe], cell_path: Path) -> tuple[Job, ...]:
    """Return the compute service's job for each recipe of a batch.

    Parameters
    ----------
    ordered : the recipes
    cell_path : cell file
    """
    paths = tuple(one.path for one in ordered)
    batch = paths if len(paths) > 1 else ()
    return tuple(Job(path, cell_path, batch) for path in paths)


@dataclass(frozen=True, slots=True)
class RunOrder:
    """The order of a run, and the place of its journal and pictures.

    Attributes
    ----------
    recipe_path, recipe, count : the first recipe, and how many parts of it
    emulated : report of the emulator about itself; empty on a real cell
    clock : clock of the cell
    runs_dir : folder of all runs; the cell's journal stands in it
    is_part_removed : the operator states that no gripper holds anything
    papers : operator and part labels, for the report
    recovery : decision on a part that an earlier run left in a gripper
    is_stepwise : the operator lets each motion begin
    are_trays_empty : the operator states that nothing stands in the trays
    beside : further recipes, of other parts
    """

    recipe_path: Path
    cell_path: Path
    recipe: Recipe
    cell: Cell
    count: int
    speed: float
    emulated: Mapping[str, Any]
    clock: FoundClock
    runs_dir: Path
    run_id: str
    is_part_removed: bool = False
    papers: Papers = NO_PAPERS
    recovery: RecoveryPolicy = "refuse"
    is_stepwise: bool = False
    are_trays_empty: bool = False
    beside: tuple[OrderedRecipe, ...] = ()

    @property
    def ordered(self) -> tuple[OrderedRecipe, ...]:
        """All recipes, in order."""
        return (OrderedRecipe(self.recipe_path, self.recipe, self.count), *self.beside)

    @property
    def part_count(self) -> int:
        """The number of parts ordered in all."""
        return sum(one.count for one in self.ordered)

    @property
    def jobs(self) -> tuple[Job, ...]:
        """The compute service's job for each recipe."""
        return jobs_of(self.ordered, self.cell_path)

    @property
    def folder(self) -> Path:
        """The run's own folder."""
        return self.runs_dir / self.run_id
