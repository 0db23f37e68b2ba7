"""A person guides the finger tips of a limp arm by hand, and sets them down by eye.

Motors that hold do not yield. The person's target is visible in the cell; no answer contains it.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from emulators.arms import EmulatedArm
from emulators.world import Layout
from emulators.world.chain import TCP

Array = NDArray[np.float64]

AIM_MM: Final = 0.5  # accuracy of fingertips set down on a mark, in each direction
# The lower of both fingers touches; this is then the height of the point between their tips.
TOUCH_MM: Final = (0.1, 0.4)
_NEAR_MM: Final = 0.02
_ROUNDS: Final = 80
# share of the remaining distance; going beyond would mean to turn the gears back through their play
_SHARE: Final = 0.8
_STEP: Final = 1e-4
_LEVER_MM: Final = 300.0  # weighs turns against shifts


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


def tcp_of(arm: EmulatedArm, layout: Layout) -> Array:
    """Return the point between the fingertips (3,)."""
    return _tips(layout, _joints(arm))[:3, 3]


def guide(arm: EmulatedArm, layout: Layout, to_mm: Array) -> None:
    """Lead the gripper of a limp arm until its finger tips are there.

    It keeps its direction where all joints yield; where some do not, it goes as they let it.

    Parameters
    ----------
    arm : without drive
    layout : layout of the cell
    to_mm : (3,) target position

    Raises
    ------
    ValueError : motors hold, or stops are in the way
    """
    joints = layout.arm.shape.chain.joints
    led = [joints.index(name) for name in arm.led]
    R_kept = _tips(layout, _joints(arm))[:3, :3]
    for _ in range(_ROUNDS):
        q = _joints(arm)
        here = _tips(layout, q)
        off_mm = to_mm - here[:3, 3]
        if np.linalg.norm(off_mm) < _NEAR_MM:
            return
        moved = [_tips(layout, q + _STEP * np.eye(len(joints))[joint]) for joint in led]
        by = np.column_stack([_apart(here, T) / _STEP for T in moved])
        goal = np.eye(4)
        goal[:3, :3], goal[:3, 3] = R_kept, to_mm
        rows = slice(None) if len(led) == len(joints) else slice(0, 3)
        change = np.linalg.lstsq(by[rows], _SHARE * _apart(here, goal)[rows], rcond=1e-3)[0]
        arm.lead(dict(zip(arm.led, change.tolist(), strict=True)))
    left_mm = float(np.linalg.norm(to_mm - tcp_of(arm, layout)))
    raise ValueError(
        f"the finger tips stay {left_mm:.1f} mm off: motors hold the arm, or a stop is in the way"
    )


def _joints(arm: EmulatedArm) -> Array:
    return np.asarray(arm.body.joints().q, dtype=float)


def _apart(here: Array, there: Array) -> Array:
    """Return shift [mm] and turn, times `_LEVER_MM`, (6,) from one pose (4, 4) to a near one."""
    R = there[:3, :3] @ here[:3, :3].T
    turn = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2.0
    return np.concatenate([there[:3, 3] - here[:3, 3], _LEVER_MM * turn])


def _tips(layout: Layout, q: Array) -> Array:
    """Return T_world_tcp (4, 4) at a configuration (n,)."""
    return np.asarray(layout.arm.shape.chain.poses(layout.arm.T_world_base, q.tolist())[TCP])
