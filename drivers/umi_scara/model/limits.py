"""Joint limits in counts, the combined ones included (umi_rtx.md 5.2): the allowed targets.

Counts rows are ordered [elbow, shoulder, zed, wrist 1, wrist 2, yaw], the library's motor order
(§1.3). Yaw and both wrist motors have no limit of their own, only combined ones.

Sections (§) are those of umi_rtx.md.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.errors import DeviceError
from messages import key, say

from ..protocol import constants as c

COUNTS_ORDER: Final = (
    c.Axis.ELBOW,
    c.Axis.SHOULDER,
    c.Axis.ZED,
    c.Axis.WRIST1,
    c.Axis.WRIST2,
    c.Axis.YAW,
)


class OutOfRangeError(DeviceError, ValueError):
    """A target that the arm cannot or may not reach; no byte has gone out.

    Attributes
    ----------
    axis : the axis or combination of axes whose limit it is
    asked, limit : value asked for and the limit it passes [counts]
    """

    def __init__(self, axis: str, asked: float, limit: float, detail: str = "") -> None:
        super().__init__(
            say(
                "{axis}: {asked:.1f} counts required, the limit is {limit:g}{detail}",
                axis=axis,
                asked=asked,
                limit=limit,
                detail=detail,
            )
        )
        self.axis = axis
        self.asked = asked
        self.limit = limit


@dataclass(frozen=True, slots=True)
class Limit:
    """One linear limit: low <= weights @ counts <= high [counts]."""

    name: str
    weights: tuple[float, float, float, float, float, float]
    low: int
    high: int
    counts_per_unit: float
    unit: str


_THIRD: Final = float(c.YAW_ELBOW_RATIO)
LIMITS: Final = (
    Limit("elbow", (1, 0, 0, 0, 0, 0), *c.ELBOW_RANGE, c.ELBOW_COUNTS_PER_DEG, "deg"),
    Limit("shoulder", (0, 1, 0, 0, 0, 0), *c.SHOULDER_RANGE, c.SHOULDER_COUNTS_PER_DEG, "deg"),
    Limit("zed", (0, 0, 1, 0, 0, 0), *c.ZED_RANGE, c.ZED_COUNTS_PER_MM, "mm"),
    Limit(
        key("pitch (W1 + W2)"),
        (0, 0, 0, 1, 1, 0),
        *c.WRIST_SUM_RANGE,
        2 * c.WRIST_COUNTS_PER_DEG,
        "deg",
    ),
    Limit(
        key("roll (W1 - W2)"),
        (0, 0, 0, 1, -1, 0),
        *c.WRIST_DIFFERENCE_RANGE,
        2 * c.WRIST_COUNTS_PER_DEG,
        "deg",
    ),
    Limit(
        key("yaw of the gripper (Y - E/3)"),
        (-_THIRD, 0, 0, 0, 0, 1),
        *c.YAW_LESS_ELBOW_RANGE,
        c.YAW_COUNTS_PER_DEG,
        "deg",
    ),
)
_WEIGHTS: Final = np.array([limit.weights for limit in LIMITS])
_LOW: Final = np.array([limit.low for limit in LIMITS])
_HIGH: Final = np.array([limit.high for limit in LIMITS])
_ROUNDING: Final = 1e-9  # rounding error of a third of a count in binary


def limit_margins(counts: ArrayLike) -> NDArray[np.float64]:
    """Return the margin of counts to each of LIMITS [counts]; negative is outside (§5.2).

    Parameters
    ----------
    counts : (..., 6) in COUNTS_ORDER; NaN gives NaN

    Returns
    -------
    (..., 6) margins in the order of LIMITS
    """
    loads = np.asarray(counts, dtype=np.float64) @ _WEIGHTS.T
    margins = np.minimum(loads - _LOW, _HIGH - loads)
    return np.where(np.abs(margins) < _ROUNDING, 0.0, margins)


def check_limits(counts: ArrayLike, moved: Collection[c.Axis] = COUNTS_ORDER) -> None:
    """Check one row of counts against those limits of §5.2 that a moved axis has a part in.

    Raises
    ------
    OutOfRangeError : names the limit that is passed by the largest share of its range
    """
    violation = worst_violation(counts, moved)
    if violation is not None:
        raise violation


def worst_violation(
    counts: ArrayLike, moved: Collection[c.Axis] = COUNTS_ORDER
) -> OutOfRangeError | None:
    """Return the error that `check_limits` raises, or None; `counts` is (6,)."""
    row = np.asarray(counts, dtype=np.float64)
    if not np.isfinite(row).all():
        return OutOfRangeError("arm", float("nan"), float("nan"), key(" (no such pose)"))
    margins = limit_margins(row)
    is_moved = np.array([axis in moved for axis in COUNTS_ORDER])
    concerned = (_WEIGHTS[:, is_moved] != 0).any(axis=1)
    margins = np.where(concerned, margins, np.inf)
    worst = int(np.argmin(margins / (_HIGH - _LOW)))
    if margins[worst] >= 0:
        return None
    limit = LIMITS[worst]
    asked = float(_WEIGHTS[worst] @ row)
    bound = limit.low if asked < limit.low else limit.high
    excess = abs(asked - bound) / limit.counts_per_unit
    return OutOfRangeError(
        limit.name,
        asked,
        bound,
        say(
            ", passed by {excess:.2f} {unit} ({end:.1f} {unit} is the end)",
            excess=excess,
            unit=limit.unit,
            end=bound / limit.counts_per_unit,
        ),
    )
