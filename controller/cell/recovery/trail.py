"""The arm's past path, from the rows of its joint paths, and the path by which it can leave.

Paths between two changes in a gripper's content are free of contact both ways. Across such a change
(a grasp, a release) they are not: there the arm leaves by the retreat that the intent names.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

import numpy as np

from controller.arrays import FloatArray

from ..journal import rows

# Largest distance of a stopped arm from its path: axes that slow down out of step, servo error
# [rad, rad, rad, mm, rad, rad].
OFF_PATH: Final = np.array([0.06, 0.06, 0.06, 12.0, 0.06, 0.06])
# Tolerance of arrival [rad, mm].
THERE: Final = np.array([0.004, 0.004, 0.004, 0.5, 0.004, 0.004])


class _Fit(Enum):
    """The relation of an arm to a segment of its path."""

    LINE = "on its line"
    PARTLY = "some axes have gone their share of the way, the others have not set out"
    BESIDE = "each axis stands between the two ends, on a share of its own"


@dataclass(frozen=True, slots=True, eq=False)
class Leaving:
    """Waypoints (6,) by which the arm leaves, from where it stands.

    Attributes
    ----------
    is_free_at_end : the arm then stands free of everything
    is_back : True if it is the way the arm came by
    """

    waypoints: tuple[FloatArray, ...]
    is_free_at_end: bool
    is_back: bool


@dataclass(slots=True, eq=False)
class Trail:
    """The path ordered since the arm last stood clear, or since a gripper last changed hold.

    Attributes
    ----------
    behind : waypoints (6,) that the arm has passed, in order
    is_free : True if it stood free of everything at the first of them
    ahead : the waypoints that it was sent along last
    is_back : mask of the points that lead back over `behind`
    retreat : retreat of the last intent, by which the arm leaves afterwards; not begun yet
    has_arrived : True at the end of the path that it was sent along last
    """

    behind: list[FloatArray] = field(default_factory=list)
    is_free: bool = False
    ahead: tuple[FloatArray, ...] = ()
    is_back: bool = False
    retreat: tuple[FloatArray, ...] = ()
    has_arrived: bool = False

    def take(self, row: rows.Body) -> None:
        """Take one row of the journal; rows of other kinds are skipped."""
        match row:
            case rows.StoodFree():
                self.behind, self.is_free = [np.array(row.q)], True
                self.ahead = self.retreat = ()
                self.has_arrived = True
            case rows.PathBegun() if row.waypoints:
                self._settle()
                if self.retreat and not row.is_back:
                    self.behind, self.is_free = self.behind[-1:], False
                self.retreat = ()
                self.ahead = tuple(np.array(q) for q in row.waypoints)
                self.is_back = row.is_back
                self.has_arrived = False
            case rows.PathEnded():
                self.has_arrived = True
            case rows.Intent():
                self._settle()
                self.retreat = tuple(np.array(q) for q in row.retreat)

    def _settle(self) -> None:
        """Assume that the arm has reached the end of its last path."""
        if self.is_back:
            del self.behind[len(self.behind) - len(self.ahead) :]
        else:
            self.behind.extend(self.ahead)
        self.ahead, self.is_back = (), False

    @property
    def between(self) -> FloatArray:
        """The joints (n, 6) that the arm was last sent between; n may be 0."""
        return np.array([*self.behind[-1:], *self.ahead]).reshape(-1, 6)

    @property
    def standing(self) -> FloatArray:
        """The joints (n, 6) that the arm stands between; only the last ones if it got there."""
        return self.between[-1:] if self.has_arrived else self.between

    def begin_beside(self, q: FloatArray) -> FloatArray | None:
        """Return the start (6,) of the move beside whose line the arm stands; None if none.

        Parameters
        ----------
        q : (6,) present joints of the arm
        """
        points = list(self.between)
        found = _segment_of(points, q) if points else None
        return points[found[0]] if found is not None and found[1] is _Fit.BESIDE else None

    def leaving(self, q: FloatArray, proven: Sequence[FloatArray] = ()) -> Leaving | None:
        """Return the path by which the arm leaves, unless it is off its path.

        Back to the last place that was free; or, after a change in a gripper's content, on to the
        end of the path that leads away.

        Parameters
        ----------
        q : (6,) present joints of the arm
        proven : waypoints (6,) from there to `begin_beside`, proven free of contact
        """
        points = list(self.between)
        if not points:
            return None
        found = _segment_of(points, q)
        if found is None:
            return None
        k, fit = found
        if fit is _Fit.BESIDE and not (proven and (np.abs(proven[-1] - points[k]) <= THERE).all()):
            return None
        is_on_line = fit is _Fit.LINE
        # some axes have moved and others have not: the way back to where they set out is free,
        # since it is the way they came
        again = {_Fit.LINE: [], _Fit.PARTLY: [points[k]], _Fit.BESIDE: list(proven)}[fit]
        if self.is_back:
            rest = self.behind[: len(self.behind) - 1 - len(self.ahead)]
            way = [*again, *points[k + 1 :], *reversed(rest)]
            return Leaving(_from(q, way), self.is_free, is_back=is_on_line)
        if self.is_free:
            way = [*(again or [points[k]]), *reversed(points[:k]), *reversed(self.behind[:-1])]
            return Leaving(_from(q, way), is_free_at_end=True, is_back=True)
        way = [*again, *points[k + 1 :]]
        return Leaving(_from(q, way), bool(self.ahead), is_back=False)

    def retreat_from(self, q: FloatArray) -> Leaving | None:
        """Return the retreat that the last intent names; None if the arm has left that place."""
        if self.ahead or not self.behind or not self.retreat:
            return None
        if (np.abs(q - self.behind[-1]) > OFF_PATH).any():
            return None
        return Leaving(self.retreat, is_free_at_end=True, is_back=False)


def _segment_of(points: Sequence[FloatArray], q: FloatArray) -> tuple[int, _Fit] | None:
    """Return the number of the segment that q (6,) is on, and its relation to it.

    A position beside the line still counts if some axes have gone their share of the way and the
    others have not started: a controller may be killed between the orders to two boards. Otherwise
    it counts if each axis is between the ends of one segment; of several segments the nearest is
    taken.
    """
    if len(points) == 1:
        return (0, _Fit.LINE) if (np.abs(q - points[0]) <= OFF_PATH).all() else None
    best: tuple[float, int] | None = None
    beside: tuple[float, int] | None = None
    partly: int | None = None
    for k in range(len(points) - 1):
        along = points[k + 1] - points[k]
        scaled, off = along / OFF_PATH, (q - points[k]) / OFF_PATH
        length2 = float(scaled @ scaled)
        share = 0.0 if length2 == 0 else float(np.clip(off @ scaled / length2, 0.0, 1.0))
        far = float(np.abs(off - share * scaled).max())
        # where a path crosses itself, the later segment: the arm was sent along the whole of it
        if far <= 1.0 and (best is None or far <= best[0] + 0.1):
            best = (far, k)
        low, high = np.minimum(points[k], points[k + 1]), np.maximum(points[k], points[k + 1])
        is_between = ((low - OFF_PATH <= q) & (q <= high + OFF_PATH)).all()
        if is_between and (beside is None or far <= beside[0]):
            beside = (far, k)
        has_moved = np.abs(off) > 1.0
        if has_moved.any() and length2 > 0:
            moved = scaled[has_moved]
            if (moved != 0).all():
                share = float(off[has_moved] @ moved / (moved @ moved))
                is_alike = np.abs(off[has_moved] - share * moved).max() <= 1.0
                if is_alike and 0.0 <= share <= 1.0 + 1.0 / float(np.abs(moved).max()):
                    partly = k
    if best is not None:
        return best[1], _Fit.LINE
    if partly is not None:
        return partly, _Fit.PARTLY
    return None if beside is None else (beside[1], _Fit.BESIDE)


def _from(q: FloatArray, way: Sequence[FloatArray]) -> tuple[FloatArray, ...]:
    """Return a path without the first waypoints that the arm has reached already."""
    first = 0
    while first < len(way) and (np.abs(q - way[first]) <= THERE).all():
        first += 1
    return tuple(way[first:])
