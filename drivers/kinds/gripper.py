"""A fixed gripper: two jaws that open and close, and report their hold."""

from enum import Enum
from typing import Protocol


class Hold(Enum):
    """Whether the part of the last grasp is still there."""

    NOTHING = "nothing"  # no part was gripped
    HELD = "held"
    LOST = "lost"
    UNKNOWN = "unknown"  # the gripper restarted or its jaws are moving: go and look


class GripperReading(Protocol):
    """The state of a gripper at an instant."""

    @property
    def opening_mm(self) -> float:
        """Opening between the pads [mm]."""
        ...

    @property
    def is_activated(self) -> bool:
        """Whether it can be moved without activating it first."""
        ...

    @property
    def has_fault(self) -> bool:
        """Whether a fault prevents a move."""
        ...

    @property
    def is_moving(self) -> bool:
        """Whether the jaws are moving."""
        ...

    @property
    def has_contact(self) -> bool:
        """Whether an object stopped the jaws in their last move."""
        ...

    @property
    def has_arrived(self) -> bool:
        """Whether the jaws' last move met nothing."""
        ...


class GraspReading(Protocol):
    """The result of a grasp. An empty one is a result, not an error."""

    @property
    def object_detected(self) -> bool:
        """Whether something is between the jaws."""
        ...

    @property
    def opening_mm(self) -> float:
        """Opening between the pads [mm]."""
        ...


class FixedGripper(Protocol):
    """The gripper that is bolted to the cell.

    Attributes
    ----------
    model : name used in messages and the journal, once connected
    max_opening_mm : largest opening [mm]
    """

    @property
    def model(self) -> str: ...  # noqa: D102  (an attribute)

    @property
    def max_opening_mm(self) -> float: ...  # noqa: D102  (an attribute)

    async def connect(self) -> GripperReading:
        """Open the line and return the first reading; nothing moves, a held part stays held."""
        ...

    async def status(self) -> GripperReading:
        """Return a fresh reading. Faults are in it, not raised."""
        ...

    async def hold(self) -> Hold:
        """Return the state of the last grasp's hold. A loss stays a loss."""
        ...

    async def wait_lost(self) -> None:
        """Wait until the gripped part is known to be gone."""
        ...

    async def activate(self) -> object:
        """Make it ready to move, which may move the jaws; return once it is ready."""
        ...

    async def open_to(self, opening_mm: float) -> object:
        """Move the jaws to an opening, with nothing between them; return when they are there."""
        ...

    async def close_on(self, opening_mm: float, *, force_n: float) -> GraspReading:
        """Close on a part to about this opening with this force; return when they have stopped."""
        ...

    async def stop(self) -> object:
        """Stop the jaws where they are; return once it is confirmed. A held part stays held."""
        ...

    async def aclose(self) -> None:
        """Leave the device unchanged: opens no jaw, moves nothing."""
        ...
