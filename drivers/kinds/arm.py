"""An arm with a gripper of its own: moves joints, opens and closes its jaws, stops."""

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class Stop(Enum):
    """The way in which an arm is stopped."""

    DEAD = "dead"
    """At once; motors hold."""
    RAMP = "ramp"
    """Slow down, then hold."""
    FREE = "free"
    """Let go: axes can be moved by hand, and may sink; they are enabled anew before they move."""


@dataclass(frozen=True, slots=True)
class JawReading:
    """The state of the jaws, read without homing.

    Attributes
    ----------
    is_pressing : True if they have stalled and press, on something between them or on each other
    opening_mm : [mm]; means something only if the arm was homed and has not restarted since
    """

    is_pressing: bool
    opening_mm: float


class ArmIdentity(Protocol):
    """The identity of the arm that answered `Arm.connect`."""

    @property
    def was_restarted(self) -> bool:
        """Whether it has lost its positions since it was last homed."""
        ...


class Arm(Protocol):
    """The arm and its gripper. Joints ``q`` are those of the arm's model: rad, mm for slides.

    A moving verb that is cancelled or fails stops the arm before it ends.

    Attributes
    ----------
    model : name used in messages and the journal, once connected
    identity : identity found by `connect`; None before it
    is_homed : True if positions are valid
    max_opening_mm : largest opening of its gripper [mm]
    """

    @property
    def model(self) -> str: ...  # noqa: D102  (an attribute)

    @property
    def identity(self) -> ArmIdentity | None: ...  # noqa: D102  (an attribute)

    @property
    def is_homed(self) -> bool: ...  # noqa: D102  (an attribute)

    @property
    def max_opening_mm(self) -> float: ...  # noqa: D102  (an attribute)

    async def connect(self) -> ArmIdentity:
        """Open the line and return the arm's identity; nothing moves."""
        ...

    async def enable_power(self) -> None:
        """Allow motor power; only once people agree to motion."""
        ...

    async def home(self) -> None:
        """Find the references of all axes; may sweep the whole reach, and moves the jaws."""
        ...

    async def take_over_positions(self, between: NDArray[np.float64]) -> None:
        """Take over positions from an earlier controller's homing, if they can be proven.

        Nothing moves. For recovery after a crash: homing would sweep the whole reach with the part
        in the gripper.

        Parameters
        ----------
        between : (m, n) joints between which the arm was last sent

        Raises
        ------
        PositionLostError : it has restarted, is not where it was sent, or cannot prove anything
        """
        ...

    async def read_kept_q(self, between: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the joints (n,) that an earlier controller's homing proves; NaN for the others.

        Parameters
        ----------
        between : (m, n) joints between which the arm was last sent
        """
        ...

    async def home_keeping_jaws(
        self, q_estimate: NDArray[np.float64], opening_mm: float | None
    ) -> float:
        """Press the jaws, and find the references of all joints; no jaw opens.

        Where it takes the joints, `homing_sweep` of the arm's model tells.

        Parameters
        ----------
        q_estimate : (n,) about where it stands
        opening_mm : opening at which the jaws pressed on what they hold, None for empty jaws

        Returns
        -------
        the opening at which they press now [mm]; smaller if nothing is between them any more

        Raises
        ------
        PositionLostError : the jaws were moved meanwhile; nothing has moved
        """
        ...

    async def move_joints(self, q: NDArray[np.float64], *, speed_share: float = 1.0) -> None:
        """Move to joints (n,), all arriving together; return when the arm is there.

        Parameters
        ----------
        q : target joints
        speed_share : share of the usual speed, above 0 to 1
        """
        ...

    async def read_q(self) -> NDArray[np.float64]:
        """Return the arm's joints (n,)."""
        ...

    async def stop(self, kind: Stop) -> None:
        """Stop all axes ahead of all other traffic; opens no jaw."""
        ...

    async def grasp(self, force: int, *, speed_share: float = 1.0) -> float:
        """Close the jaws until they stall; return the opening [mm].

        Parameters
        ----------
        force : 20 to 60
        speed_share : share of the speed with which they usually close on something, above 0 to 1
        """
        ...

    async def move_gripper_mm(self, opening_mm: float) -> float:
        """Move empty jaws to an opening [mm]; return the one reached."""
        ...

    async def read_opening_mm(self) -> float:
        """Return the present opening of the jaws [mm]."""
        ...

    async def read_jaws(self) -> JawReading:
        """Return the state of the jaws, homed or not; nothing moves."""
        ...

    async def drive_jaws(self, by_mm: float) -> float:
        """Open (below 0: close) the jaws by a travel [mm]; return the travel they made."""
        ...

    async def aclose(self) -> None:
        """Stop, and release the line; opens no jaw."""
        ...
