"""What to run: recipe, cell, how many parts, and what goes with them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from controller.config import Cell, Recipe

from ..devices.clocks import FoundClock


@dataclass(frozen=True, slots=True)
class Papers:
    """What goes with the parts, as the operator gives it; an empty text is not known.

    Attributes
    ----------
    serials : of the parts, in the order they are worked on
    part_temperature_c : None where nobody measured it
    """

    operator: str = ""
    lot: str = ""
    serials: tuple[str, ...] = ()
    part_temperature_c: float | None = None


NO_PAPERS: Final = Papers()
# What a start does where an earlier run may have left a part in a gripper: refuse; have the
# operator decide on a proposal; go on by itself where the proposal is proven safe.
RecoveryPolicy = Literal["refuse", "ask", "auto"]


@dataclass(frozen=True, slots=True)
class RunOrder:
    """What to run, and where its journal and pictures go.

    Attributes
    ----------
    emulated : what the emulator reported of itself, empty on a real cell
    clock : of the cell
    runs_dir : folder of all runs; the cell's journal stands in it
    is_part_removed : the operator states that no gripper holds anything
    papers : who runs it, and which parts, for the report
    recovery : what to do with a part that an earlier run left in a gripper
    is_stepwise : the operator lets each motion begin
    are_trays_empty : the operator states that nothing stands in the trays
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

    @property
    def folder(self) -> Path:
        """The run's own folder."""
        return self.runs_dir / self.run_id
