"""The joints swept by homing with shut jaws, phase by phase; nothing moves here.

The phases are those of `motion._keeping` and in their order (umi_rtx.md 4.7). Each is a box in the
independent angles of the joints: the gripper's angle to the forearm stands in for the yaw motor's,
since its stops are there (umi_rtx.md 5.4). An axis that is driven to a stop covers the whole way;
two that are driven at once may lead or lag, so that they cover all that lies between.

Sections (§) are those of umi_rtx.md.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from messages import key

from ..protocol import constants as c
from . import kinematics

Floats = NDArray[np.float64]

__all__ = ["SweepPhase", "homing_sweep"]

_SHOULDER, _ELBOW, _HAND, _ZED, _PITCH, _ROLL = range(6)
# tolerance [rad, mm] of an axis that rests on its stop, or was stopped on the move
_SLACK: Final = np.array([0.02, 0.02, 0.02, 3.0, 0.02, 0.02])
# §5.3: while the wrist's two motors turn it about one axis, an uneven pair turns it about the other
_UNEVEN_RAD: Final = 0.1
_ASIDE_RAD: Final = float(np.radians(c.KEEPING_SHOULDER_COUNTS / c.SHOULDER_COUNTS_PER_DEG))

# q = JOIN @ u: the belt takes half of the elbow's turn back (§5.4)
_JOIN: Final = np.eye(6)
_JOIN[2, 1] = float(c.YAW_ELBOW_RATIO) * c.ELBOW_COUNTS_PER_DEG / c.YAW_COUNTS_PER_DEG


@dataclass(frozen=True, slots=True, eq=False)
class SweepPhase:
    """One phase of a motion, as the joints that it may pass.

    Attributes
    ----------
    what : in words, for a message
    low, high : (6,) bounds of independent angles [rad, zed in mm]
    join : (6, 6), joints are ``join @ angles``
    """

    what: str
    low: Floats
    high: Floats
    join: Floats


def homing_sweep(low: Floats, high: Floats) -> tuple[SweepPhase, ...]:
    """Return the phases of homing from anywhere within bounds of the joints.

    Parameters
    ----------
    low, high : (6,) bounds of the joints at its beginning, in `kinematics.Q_ORDER`; the driver
        takes the arm to stand in their middle
    """
    least, most = _limits()
    share = _JOIN[2, 1]
    off = (np.asarray(high, np.float64) - low) / 2 + _SLACK
    low, high = np.array(low, np.float64), np.array(high, np.float64)
    low[_HAND], high[_HAND] = low[2] - share * high[1], high[2] - share * low[1]
    phases = []

    def spread(axis: int, first: float, last: float) -> None:
        low[axis], high[axis] = max(first, least[axis]), min(last, most[axis])

    def spread_to(axis: int, place: float, slack: float) -> None:
        spread(axis, min(low[axis], place - slack), max(high[axis], place + slack))

    def rest_at(axis: int, place: float, slack: float) -> None:
        spread(axis, place - slack, place + slack)

    def add(what: str) -> None:
        phases.append(SweepPhase(what, low.copy(), high.copy(), _JOIN))

    for axis in range(6):
        spread(axis, low[axis], high[axis])
    high[_ZED] = most[_ZED]
    add(key("zed goes up to its stop"))
    rest_at(_ZED, 0.0, _SLACK[_ZED])
    off_hand = off[2] + share * off[_ELBOW]
    for axis, slack in ((_ELBOW, off[_ELBOW]), (_HAND, off_hand)):
        spread_to(axis, 0.0, slack)
    add(key("elbow and yaw straighten"))
    rest_at(_ELBOW, 0.0, off[_ELBOW])
    rest_at(_HAND, 0.0, off_hand)
    spread_to(_SHOULDER, _ASIDE_RAD, off[_SHOULDER])
    add(key("the shoulder goes aside"))
    rest_at(_SHOULDER, _ASIDE_RAD, off[_SHOULDER])
    spread(_ELBOW, -off[_ELBOW], most[_ELBOW])
    # the yaw motor stands still meanwhile: the third angle is its own
    rest_at(_HAND, 0.0, off[2])
    phases.append(
        SweepPhase(key("the elbow goes to its stop"), low.copy(), high.copy(), np.eye(len(low)))
    )
    rest_at(_ELBOW, 0.0, _SLACK[_ELBOW])
    spread(_HAND, least[_HAND], off_hand)
    add(key("the yaw goes to its stop"))
    rest_at(_HAND, 0.0, _SLACK[_HAND])
    spread(_SHOULDER, _ASIDE_RAD - off[_SHOULDER], most[_SHOULDER])
    add(key("the shoulder goes to its stop"))
    rest_at(_SHOULDER, 0.0, _SLACK[_SHOULDER])
    spread(_ZED, c.KEEPING_ZED_COUNTS / c.ZED_COUNTS_PER_MM - _SLACK[_ZED], most[_ZED])
    for axis in (_PITCH, _ROLL):
        spread(axis, least[axis], max(high[axis] + _UNEVEN_RAD, _SLACK[axis]))
    add(key("the wrist goes to its stops"))
    return tuple(phases)


def _limits() -> tuple[Floats, Floats]:
    """Return the stops of the independent angles (6,): all that the arm can reach."""
    least, most = kinematics.JOINT_RANGES.copy()
    hand = np.array(c.YAW_LESS_ELBOW_RANGE) / np.rad2deg(c.YAW_COUNTS_PER_DEG)
    least[_HAND], most[_HAND] = hand
    least[_ZED], most[_ZED] = np.array(c.ZED_STOPS) / c.ZED_COUNTS_PER_MM
    return least, most
