"""The far sides of gears with play, by the travel of their motors.

The encoders sit on the motors, before the gears (umi_rtx.md 5): with play a joint follows its motor
only once the play is used up. Counts of a joint are here those of a motor that has come from below.
"""

from collections.abc import Mapping

from ..protocol.constants import Axis

_CLOSE_COUNTS = 0.5  # error of rounding to a whole count


class GearPlay:
    """Follows the far side of each gear, and finds the motor's counts for a joint.

    Parameters
    ----------
    counts : play of each motor's gears, from one flank to the other [counts]; others have none
    """

    def __init__(self, counts: Mapping[Axis, float]) -> None:
        self._play = {axis: float(play) for axis, play in counts.items() if play > 0}
        self._far: dict[Axis, float] = {}

    def forget(self) -> None:
        """Forget all: far sides are taken to be where a motor from below leaves them."""
        self._far.clear()

    def note(self, counts: Mapping[Axis, float]) -> None:
        """Note the new positions of motors, each moved in one direction since the last note."""
        for axis, play in self._play.items():
            if axis in counts:
                at = counts[axis]
                far = self._far.get(axis, at - play / 2)
                self._far[axis] = min(max(far, at - play / 2), at + play / 2)

    def meant(self, axis: Axis, counts: float) -> float:
        """Return the joint's position for a motor at ``counts``."""
        if axis not in self._play:
            return counts
        half = self._play[axis] / 2
        far = self._far.get(axis, counts - half)
        return min(max(far, counts - half), counts + half) + half

    def targets(self, joints: Mapping[Axis, int], motors: Mapping[Axis, int]) -> dict[Axis, int]:
        """Return the motor targets for joints, each by the shortest way.

        Parameters
        ----------
        joints : target of each joint [counts]
        motors : position of each motor [counts]
        """
        return {axis: self._target(axis, counts, motors[axis]) for axis, counts in joints.items()}

    def _target(self, axis: Axis, joint: int, motor: int) -> int:
        if axis not in self._play:
            return joint
        off = joint - self.meant(axis, motor)
        if abs(off) < _CLOSE_COUNTS:
            return motor
        return joint if off > 0 else round(joint - self._play[axis])
