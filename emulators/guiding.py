"""A person guides the finger tips of a limp arm by hand, and sets them down by eye.

Motors that hold do not yield. The person's target is visible in the cell; no answer contains it.
"""

import math
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from emulators.umi_scara import COUNTS_PER_DEG, ZED_COUNTS_PER_MM, ArmJoints, ArmModel, Axis
from emulators.world import Layout
from emulators.world.chain import TCP
from emulators.world.poses import forward

Array = NDArray[np.float64]

AIM_MM: Final = 0.5  # accuracy of fingertips set down on a mark, in each direction
# The lower of both fingers touches; this is then the height of the point between their tips.
TOUCH_MM: Final = (0.1, 0.4)
_NEAR_MM: Final = 0.02
_ROUNDS: Final = 80
# share of the remaining distance; going beyond would mean to turn the gears back through their play
_SHARE: Final = 0.8
_STEP: Final = 1e-4
_COUNTS: Final = {
    Axis.SHOULDER: math.degrees(COUNTS_PER_DEG[Axis.SHOULDER]),
    Axis.ELBOW: math.degrees(COUNTS_PER_DEG[Axis.ELBOW]),
    Axis.ZED: ZED_COUNTS_PER_MM,
}
_JOINTS: Final = ("shoulder_rad", "elbow_rad", "zed_mm")


def aimed_at(
    layout: Layout, tcp_mm: Array, tray: str | None, corner: tuple[int, int], seed: int
) -> Array:
    """Return the point (3,) where a person sets the fingertips down.

    Parameters
    ----------
    layout : layout of the cell as it really stands
    tcp_mm : (3,) present position
    tray : tray in whose corner; None for the table right below
    corner : -1 or 1 along x and y
    seed : seed of how well the person aims

    Raises
    ------
    ValueError : no such tray or corner
    """
    rng = np.random.default_rng([seed, 0x6D])
    height_mm = rng.uniform(*TOUCH_MM)
    if tray is None:
        return np.array([tcp_mm[0], tcp_mm[1], height_mm])
    named = {one.name: one for one in layout.trays}
    if tray not in named:
        raise ValueError(f"tray {tray!r} is none of {', '.join(named)}")
    if not all(side in (-1, 1) for side in corner):
        raise ValueError(f"corner {corner!r}: -1 or 1 along x and y")
    one = named[tray]
    place = one.centre_mm + np.array(corner) * one.size_mm / 2.0
    return np.append(place + rng.uniform(-AIM_MM, AIM_MM, 2), height_mm)


def tcp_of(arm: ArmModel, layout: Layout) -> Array:
    """Return the point between the fingertips (3,)."""
    return _tips(layout, arm.joints())


def guide(arm: ArmModel, layout: Layout, to_mm: Array) -> None:
    """Pull shoulder, elbow and zed of a limp arm until its finger tips are there.

    Parameters
    ----------
    arm : without drive
    layout : layout of the cell
    to_mm : (3,) target position

    Raises
    ------
    ValueError : motors hold, or stops are in the way
    """
    for _ in range(_ROUNDS):
        off = to_mm - tcp_of(arm, layout)
        if np.linalg.norm(off) < _NEAR_MM:
            return
        joints = arm.joints()
        here = _tips(layout, joints)
        by = np.column_stack(
            [
                (_tips(layout, replace(joints, **{name: getattr(joints, name) + _STEP})) - here)
                / _STEP
                for name in _JOINTS
            ]
        )
        change = np.linalg.lstsq(by, _SHARE * off, rcond=1e-3)[0]
        for (axis, per_unit), much in zip(_COUNTS.items(), change, strict=True):
            arm.push(axis, float(much) * per_unit)
    left_mm = float(np.linalg.norm(to_mm - tcp_of(arm, layout)))
    raise ValueError(
        f"the finger tips stay {left_mm:.1f} mm off: motors hold the arm, or a stop is in the way"
    )


def _tips(layout: Layout, joints: ArmJoints) -> Array:
    return np.asarray(forward(layout.arm, joints)[TCP][:3, 3])
