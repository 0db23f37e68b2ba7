"""The operator's view of the run at a moment."""

from dataclasses import dataclass

from controller.cell.custody import Custody
from controller.cell.devices.clocks import Speed


@dataclass(slots=True)
class RunProgress:
    """The operator's view of the run at a moment."""

    state: str = "stopped"
    step: int = 0
    step_count: int = 0
    label: str = ""
    part_pose: str = ""
    remaining_s: float | None = None
    custody: Custody = Custody.NONE
    speed: Speed | None = None
