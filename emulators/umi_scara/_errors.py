"""The differences of one arm from its counters: zeros, gear play, coupling, sag.

umi_rtx.md 4.2 has factory values for the stops and 5 nominal scales; no arm is exactly so, and its
encoders sit on the motors, before the gears. These errors are between motors and joints, where no
counter sees them.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from ._axes import ArmJoints, Axis


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmErrors:
    """Differences between an arm and its description; all 0 is a perfect arm.

    Attributes
    ----------
    zero_rad : angles of `shoulder_rad`, `elbow_rad`, `yaw_rad`, `pitch_rad`, `roll_rad` at which
        their counters mean 0
    zed_zero_mm : the same of zed
    jaw_zero_mm : opening when the counter means 0: pads that are thinner than nominal
    play_counts : play of each motor's gears, from one flank to the other
    yaw_per_elbow : heading that a turn of the elbow adds to the nominal half of it
    sag_mm : by how much the stretched arm hangs lower; less as the elbow folds, with the square of
        the reach
    """

    zero_rad: Mapping[str, float] = field(default_factory=dict)
    zed_zero_mm: float = 0.0
    jaw_zero_mm: float = 0.0
    play_counts: Mapping[Axis, float] = field(default_factory=dict)
    yaw_per_elbow: float = 0.0
    sag_mm: float = 0.0

    def joints(self, nominal: ArmJoints) -> ArmJoints:
        """Return the true joints for the joints by the gears' far sides."""
        turned = {name: getattr(nominal, name) + off for name, off in self.zero_rad.items()}
        joints = replace(nominal, **turned)
        reach = math.cos(joints.elbow_rad / 2.0)  # as a share of the stretched arm
        return replace(
            joints,
            yaw_rad=joints.yaw_rad + self.yaw_per_elbow * joints.elbow_rad,
            zed_mm=joints.zed_mm + self.zed_zero_mm - self.sag_mm * reach * reach,
            jaw_opening_mm=max(0.0, joints.jaw_opening_mm + self.jaw_zero_mm),
        )


PERFECT = ArmErrors()
