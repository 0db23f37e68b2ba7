"""The world's inputs and outputs: models that others command, events, snapshots."""

from dataclasses import dataclass
from typing import Protocol

from .poses import Joints
from .shapes import Array


class ArmBody(Protocol):
    """The arm in the world."""

    grasp_limit_mm: float | None

    def advance(self, dt_s: float) -> None:
        """Let time pass [s]."""
        ...

    def joints(self) -> Joints:
        """Return the true joints."""
        ...


class JawBody(Protocol):
    """The fixed gripper's jaws in the world."""

    grasp_limit_mm: float | None

    @property
    def opening_mm(self) -> float:
        """The distance between the jaws."""
        ...

    def advance(self, dt_s: float) -> None:
        """Let time pass [s]."""
        ...


@dataclass(frozen=True, slots=True)
class Event:
    """Something happened to a part.

    That is ``gripped``, ``missed``, ``released``, ``fell_out``, ``taken``, ``torn``, ``lies`` or
    ``emptied``.

    Attributes
    ----------
    by : the gripper, or the tray that was emptied; empty for ``lies``
    lowest_mm : height of the part's lowest point above the table
    is_held : True if a gripper has the part now
    """

    at_s: float
    what: str
    part: int
    by: str
    lowest_mm: float = 0.0
    is_held: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """The poses ``T_world_*`` of all that moves at one instant, by name [mm].

    Parts are ``part 0``, ``part 1`` ...; the arm's links have the names of its chain, its last
    frame is ``arm gripper``; fingers are ``arm finger +`` and so on.
    """

    at_s: float
    poses: dict[str, Array]
