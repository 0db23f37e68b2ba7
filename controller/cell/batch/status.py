"""The status of a running cell, for observers outside."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from controller.cell.journal.rows import FirstMotion

from ..custody import Custody
from ..machine import PauseKind, SafePoint


@dataclass(frozen=True, slots=True)
class CellStatus:
    """The cell at a moment.

    Attributes
    ----------
    at_s : the cell's clock [cell s]
    state : state of the machine
    label : current activity, for people
    step, step_count : number of the step, and of all steps of the plan, from 1; 0 without one
    custody : gripper, tray or table with the part
    remaining_s : remaining time of the plan [cell s]; None if unknown
    message : message of the last fault or problem
    alarm : its number and words; empty without one
    point : the safe point at which the cell stands
    wanted : the pause that is wanted and not reached yet
    pause_s : longest time until each kind of pause begins [cell s]
    first : first motion after the pause; None if nothing is paused
    barred : condition for a resume; empty if it is allowed
    recipe, serial : recipe and serial of the part at hand; empty before it was recognised, or where
        it has none
    done : by recipe, parts done and parts ordered
    signals : inputs of the I/O block by name: whether each is OK, None if nobody knows
    """

    at_s: float
    state: str
    label: str
    step: int
    step_count: int
    custody: Custody
    remaining_s: float | None
    message: str
    alarm: str
    point: SafePoint | None
    wanted: PauseKind | None
    pause_s: Mapping[PauseKind, float | None]
    first: FirstMotion | None
    barred: str = ""
    signals: Mapping[str, bool | None] = field(default_factory=dict)
    recipe: str = ""
    serial: str = ""
    done: Mapping[str, tuple[int, int]] = field(default_factory=dict)
