"""Resting on a curve: where a part rolls, and where it rocks to a stop.

Seen from the centre of mass a round wall is a valley. Level for a quarter turn and more, the part
rolls along it and lies anywhere (a rod, a ball, a cone); with a lowest place, it rocks to that one
(the round side of a D-shaped rod). A tessellation has its corners on the true curve, so the lowest
place is found on the curve: at constant radius the height is R + u . (c - com) for a direction u
down, c the point on the axis; of any other curve it is taken as quadratic near the lowest strip.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from controller.arrays import FloatArray, IntArray, square_to

from ..graph import components
from ._curves import PLANE_RATIO, WIDE_RATIO, Strips
from ._hull import Hull

RollKind = Literal["cylinder", "cone", "ball", "other"]

QUARTER_TURN = np.pi / 2
GAP = 1.6  # a ring is closed if no gap between strips is this many times wider than the widest
OPEN_RAD = np.radians(46.0)  # widest gap of a closed ring, that of a circle of eight corners
EVEN_RAD = np.radians(4.0)  # strips of one ring are tilted alike up to this
DOME_RAD = np.radians(20.0)  # a ring this narrow may be the fan of triangles round a pole
ROUND_MM = 0.01  # largest misfit of a curve of constant radius


@dataclass(frozen=True, eq=False, slots=True)
class RollingFamily:
    """Strips of one curve on which a part rolls: one stable pose, not many.

    Attributes
    ----------
    pose : index of the pose that stands for the family
    kind : "cylinder": along a straight line; "cone": round in a circle; "ball": any way; "other":
        over a curve of changing radius
    axis : (3,) unit, CAD frame, about which the direction down turns in the part; zeros for a ball
    centre_mm : (3,) a point of that axis, CAD frame; for a ball its centre
    radius_mm : (2,) least and greatest distance of the corners that touch the table from the axis
        (from the centre, of a ball)
    heights_mm : (2,) least and greatest height of the centre of mass over the roll
    arc_rad : angle that it rolls, 2 pi if it never stops; 2 pi for a ball too
    probability, drop_probability : probability and drop probability of the family, as of a pose
    downs : (m, 3) directions to the table, CAD frame, of the strips, likeliest first
    probabilities : (m,) quasi-static, of each strip
    """

    pose: int
    kind: RollKind
    axis: FloatArray
    centre_mm: FloatArray
    radius_mm: FloatArray
    heights_mm: FloatArray
    arc_rad: float
    probability: float
    drop_probability: float
    downs: FloatArray
    probabilities: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class Roll:
    """The hollow of a curve; all from the centre of mass, in the CAD frame's axes.

    Attributes
    ----------
    rolls : whether the part lies anywhere along the curve; else it rocks to ``down``
    down : (3,) direction to the table at its lowest place
    kind, axis, centre_mm, arc_rad : as in `RollingFamily`
    reach : facets it rolls or rocks over
    """

    rolls: bool
    down: FloatArray
    kind: RollKind
    axis: FloatArray
    centre_mm: FloatArray
    arc_rad: float
    reach: IntArray


class CurvedRegions:
    """Curved regions of a hull, and the rest of a part on each."""

    def __init__(self, hull: Hull, strips: Strips) -> None:
        self._hull, self._strips = hull, strips
        order = np.argsort(strips.region, kind="stable")
        self._by_region = np.split(order, np.cumsum(np.bincount(strips.region))[:-1])
        inner = strips.is_smooth & (
            strips.region[hull.edge_facets[:, 0]] == strips.region[hull.edge_facets[:, 1]]
        )
        self._edges = hull.edge_facets[inner]

    def roll_at(self, bottom: int, held: IntArray) -> Roll | None:
        """Return the `Roll` in the hollow with the lowest strip ``bottom``; None where it is flat.

        ``held`` are the strips (m,) of the hollow that hold the part by themselves.
        """
        hull = self._hull
        reach = self._reach(bottom)
        if self._is_flat(bottom, reach):
            return None
        held = np.intersect1d(held, reach)
        normals, heights = hull.normals[reach], hull.heights_mm[reach]
        # a rounded rim beside the wall tilts the part a little; the wall's own strips tell the ring
        wall = hull.normals[held] if len(held) >= 6 else normals
        axis, tilt, spread = _ring_of(wall)
        ring = spread < max(0.1 * tilt, min(EVEN_RAD, 0.5 * tilt))
        ring = ring and not self._is_dome(axis, tilt, heights)
        along = np.abs(np.arccos(np.clip(normals @ axis, -1, 1)) - tilt) < EVEN_RAD
        arc, closed = _arc(normals[along] if ring else normals, axis)
        widest = float(np.arccos(np.clip((normals @ hull.normals[bottom]).min(), -1, 1)))
        slack = self._strips.lift_mm / 5 + 2 * float(self._strips.bulge_mm[reach].max())
        level = len(held) >= 3 and float(np.ptp(heights)) < min(slack, self._strips.lift_mm)
        centre = _centre_of(normals, heights)
        if ring and closed and len(reach) >= 6:
            upright = abs(tilt - QUARTER_TURN) < EVEN_RAD
            kind: RollKind = "cylinder" if upright else "cone"
            rolls, arc = True, 2 * np.pi
        elif not ring and widest >= QUARTER_TURN:
            kind, rolls, arc = "ball", True, 2 * np.pi
        else:
            kind = "cylinder" if ring and abs(tilt - QUARTER_TURN) < EVEN_RAD else "other"
            rolls = (ring and arc >= QUARTER_TURN) or level
        off = heights - normals @ centre
        if ring:
            off = off[along]
        if kind == "cylinder" and float(np.ptp(off)) > ROUND_MM + slack:
            kind = "other"
        down = hull.normals[bottom]
        if not rolls:
            down = self._lowest(bottom, reach, centre)
        if kind == "ball":
            axis = np.zeros(3)
        elif ring:
            centre = centre - (centre @ axis) * axis
        return Roll(rolls, down, kind, axis, centre, float(arc), reach)

    def _is_flat(self, bottom: int, reach: IntArray) -> bool:
        """Return True for a facet much larger than those it runs into: a chord or a ground flat."""
        hull, strips = self._hull, self._strips
        if strips.is_band[bottom]:
            return False
        beside = hull.edge_facets[strips.is_smooth & (hull.edge_facets == bottom).any(axis=1)]
        others = np.setdiff1d(np.union1d(beside, reach), [bottom])
        if not len(others):
            return True
        ratio = WIDE_RATIO if strips.is_wide[bottom] else PLANE_RATIO
        return bool(hull.areas_mm2[bottom] > ratio * np.median(hull.areas_mm2[others]))

    def _is_dome(self, axis: FloatArray, tilt: float, heights: FloatArray) -> bool:
        """Return True for a narrow ring of directions round a dip: a dome's top, not a cone."""
        top = float(self._hull.extent_mm(axis[None])[0])
        return tilt < DOME_RAD and top < float(heights.max()) + self._strips.lift_mm

    def _reach(self, bottom: int) -> IntArray:
        """Return the facets of the curve within a small climb from its lowest."""
        hull, strips = self._hull, self._strips
        region = int(strips.region[bottom])
        allowed = max(strips.lift_mm, 2 * float(strips.bulge_mm[bottom]))
        low = hull.heights_mm <= hull.heights_mm[bottom] + allowed
        ours = np.zeros(hull.count, dtype=bool)
        ours[self._by_region[region]] = True
        low &= ours
        local = np.cumsum(low) - 1
        inside = low[self._edges].all(axis=1)
        pairs = local[self._edges[inside]]
        count = int(low.sum())
        group = components(count, pairs[:, 0], pairs[:, 1])
        return np.asarray(np.flatnonzero(low)[group == group[local[bottom]]])

    def _lowest(self, bottom: int, reach: IntArray, centre: FloatArray) -> FloatArray:
        """Return the direction down (3,) in which a rocking part comes to rest."""
        hull = self._hull
        normals, heights = hull.normals[reach], hull.heights_mm[reach]
        here: FloatArray = np.asarray(hull.normals[bottom], dtype=np.float64)
        near = normals @ here > np.cos(np.radians(35.0))
        normals, heights = normals[near], heights[near]
        if len(normals) < 3:
            return here
        e1, e2 = square_to(here)
        x, y = normals @ e1, normals @ e2
        spread = np.column_stack([x, y])
        size, turn = np.linalg.eigh(spread.T @ spread)
        one_way = size[0] < 1e-4 * size[1]  # a cylinder or a cone rocks about one axis only
        main = spread @ turn[:, 1]
        system = (
            np.column_stack([np.ones_like(main), main, main**2])
            if one_way
            else np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
        )
        if len(system) < system.shape[1]:
            return here
        round_fit = heights - normals @ centre
        if float(np.ptp(round_fit)) < ROUND_MM + float(self._strips.bulge_mm[reach].max()):
            flat = -centre
            if one_way:
                # the direction stays in the ring of the strips' normals
                side = e1 * turn[0, 0] + e2 * turn[1, 0]
                flat = flat - (flat @ side) * side
                tilt = float((normals @ side).mean())
                length = float(np.linalg.norm(flat))
                if length < 1e-9:
                    return here
                down = flat / length * np.sqrt(max(1 - tilt * tilt, 0.0)) + tilt * side
            else:
                down = flat / max(float(np.linalg.norm(flat)), 1e-12)
            return np.asarray(down if down @ here > (normals @ here).min() - 1e-9 else here)
        c = np.linalg.lstsq(system, heights, rcond=None)[0]
        if one_way:
            if c[2] <= 0:
                return here
            step = -c[1] / (2 * c[2]) * (e1 * turn[0, 1] + e2 * turn[1, 1])
        else:
            bend = np.array([[2 * c[3], c[4]], [c[4], 2 * c[5]]])
            if np.linalg.eigvalsh(bend)[0] <= 0:
                return here
            u, v = -np.linalg.solve(bend, c[1:3])
            step = u * e1 + v * e2
        if np.linalg.norm(step) > np.sqrt(max(1 - float((normals @ here).min()) ** 2, 0.0)):
            return here
        down = here * np.sqrt(max(1 - float(step @ step), 0.0)) + step
        return np.asarray(down / np.linalg.norm(down))


def _ring_of(normals: FloatArray) -> tuple[FloatArray, float, float]:
    """Return the axis (3,) of a ring of normals (n, 3), their mean tilt to it, and its spread."""
    off = normals - normals.mean(axis=0)
    axis = np.linalg.eigh(off.T @ off)[1][:, 0]
    if axis[np.argmax(np.abs(axis))] < 0:
        axis = -axis  # the same axis from the same part, whatever the solver's sign
    if (normals @ axis).mean() < -1e-6:
        axis = -axis  # towards the strips' side, as a cone's axis towards its apex
    tilts = np.arccos(np.clip(normals @ axis, -1, 1))
    return axis, float(tilts.mean()), float(np.ptp(tilts))


def _arc(normals: FloatArray, axis: FloatArray) -> tuple[float, bool]:
    """Return the angle that normals (n, 3) cover round an axis, and True if it closes."""
    e1, e2 = square_to(axis)
    turns = np.sort(np.arctan2(normals @ e2, normals @ e1))
    if len(turns) < 2:
        return 0.0, False
    gaps = np.append(np.diff(turns), turns[0] + 2 * np.pi - turns[-1])
    widest = int(np.argmax(gaps))
    others = np.delete(gaps, widest)
    closed = gaps[widest] <= min(GAP * max(float(others.max()), 1e-9), OPEN_RAD)
    return float(2 * np.pi - gaps[widest]), bool(closed)


def _centre_of(normals: FloatArray, heights: FloatArray) -> FloatArray:
    """Return the centre (3,) of the constant-radius curve with these heights."""
    system = np.column_stack([normals, np.ones(len(normals))])
    solution, *_ = np.linalg.lstsq(system, heights, rcond=1e-9)
    return np.asarray(solution[:3])
