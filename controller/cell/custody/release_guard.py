"""The only module that opens the jaws of the cell in a run: a held part always has a holder.

A gripper lets go only after the other gripper's hold is confirmed by a reading taken at that
moment. A part that only one gripper has is released on purpose (in a tray, on the table) or not at
all. A refusal here means a bug somewhere else: the cell aborts with everything closed.
"""

from typing import Final

from drivers.kinds import Arm, FixedGripper, Hold, IoBlock, Signal
from messages import key, say

from ..errors import ReleaseRefusedError
from .fold import Custody

LOST_MM: Final = 1.5  # jaws that close by more than this while carrying have lost the part
NOTHING_MM: Final = 3.0  # jaws this close to each other hold nothing, unless a thin part is known
# Of a thin part the least share of its thickness at which jaws may stand and still have it. Empty
# jaws stand at 0, off by what their zero is off.
THIN_SHARE: Final = 0.5


def least_held_mm(part_mm: float, play_mm: float = LOST_MM) -> float:
    """Return the least opening at which jaws have a part [mm].

    Parameters
    ----------
    part_mm : opening at which they gripped it, or should
    play_mm : by how much they may stand nearer to each other
    """
    return max(part_mm - play_mm, THIN_SHARE * part_mm)


class ReleaseGuard:
    """Opens the arm gripper and the fixed gripper, or refuses to.

    Parameters
    ----------
    arm : the arm, with its gripper
    fixed : the fixed gripper
    io : the I/O block, for the light barrier of the fixed gripper
    """

    def __init__(self, arm: Arm, fixed: FixedGripper, io: IoBlock) -> None:
        self._arm = arm
        self._fixed = fixed
        self._io = io

    async def open_arm(
        self, opening_mm: float, custody: Custody, *, lets_go: bool = False
    ) -> float:
        """Open the arm gripper; return the opening reached [mm].

        Parameters
        ----------
        opening_mm : opening of the jaws
        custody : present custody of the part
        lets_go : the part is meant to stay where the jaws are: in its tray, on the table

        Raises
        ------
        ReleaseRefusedError : nothing else is known to hold what the arm gripper holds
        """
        if custody is Custody.UNKNOWN:
            raise ReleaseRefusedError(
                key("the arm gripper stays closed: the part's custody is unknown")
            )
        if custody is Custody.IN_ARM and not lets_go:
            raise ReleaseRefusedError(key("the arm gripper stays closed: it alone holds the part"))
        if custody is Custody.IN_BOTH and (hold := await self._fixed.hold()) is not Hold.HELD:
            raise ReleaseRefusedError(
                say(
                    "the arm gripper stays closed: the fixed gripper does not confirm "
                    "its hold ({value})",
                    value=hold.value,
                )
            )
        return await self._arm.move_gripper_mm(opening_mm)

    async def open_fixed(self, opening_mm: float, custody: Custody, gripped_mm: float) -> None:
        """Open the fixed gripper.

        Parameters
        ----------
        opening_mm : opening of the jaws
        custody : present custody of the part
        gripped_mm : opening of the arm gripper since it closed on the part

        Raises
        ------
        ReleaseRefusedError : nothing else is known to hold what the fixed gripper holds
        """
        if custody in (Custody.UNKNOWN, Custody.IN_FIXED):
            raise ReleaseRefusedError(
                say(
                    "the fixed gripper stays closed: custody of the part is: {value}",
                    value=custody.value,
                )
            )
        if custody is Custody.IN_BOTH:
            arm_mm = await self._arm.read_opening_mm()
            if arm_mm < least_held_mm(gripped_mm):
                raise ReleaseRefusedError(
                    say(
                        "the fixed gripper stays closed: the arm gripper's jaws stand at "
                        "{arm_mm:.1f} mm, but the part is {gripped_mm:.1f} mm wide",
                        arm_mm=arm_mm,
                        gripped_mm=gripped_mm,
                    )
                )
        if custody is Custody.LOST and self.is_something_in_fixed:
            raise ReleaseRefusedError(
                key(
                    "the fixed gripper stays closed: the part is lost, and something is between "
                    "its jaws"
                )
            )
        await self._fixed.open_to(opening_mm)

    @property
    def is_something_in_fixed(self) -> bool:
        """Whether the light barrier of the fixed gripper sees something between its jaws."""
        return self._io.signal("part_in_gripper") is Signal.OK
