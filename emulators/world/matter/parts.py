"""One part in the world: its pose, its gripper, and whether it is at rest."""

import math
from typing import Any, Final

import fcl
import numpy as np

from ..poses import transform, turn_z
from ..shapes import Array, Box
from .solid import Solid, upright

AWAY: Final = "away"
FALLING: Final = "falling"
RESTING: Final = "at rest"
HELD: Final = "held"
PROPPED: Final = "propped"  # a person has put something under it: it does not move

_CALM_MM_PER_S: Final = 3.0
_CALM_RAD_PER_S: Final = 0.05
_CALM_S: Final = 0.2
_SNAP_RAD: Final = math.radians(4.0)  # convex pieces are a little off: they tilt a part at rest
_SNAP_MM: Final = 2.5
_FRICTION_RADIUS: Final = 0.27  # friction radius about the middle, in diagonals; a disc has 0.24


class Part:
    """A part; ``falling`` and ``carried`` are its two pybullet bodies.

    Parameters
    ----------
    index : its number in the world
    solid : its shape, mass and stable poses
    falling : pybullet's number of the body that contacts move
    carried : pybullet's number of the body that a gripper moves
    """

    def __init__(self, index: int, solid: Solid, falling: int, carried: int) -> None:
        self.index, self.solid = index, solid
        self.name = f"part {index}"
        self.falling, self.carried = falling, carried
        self.state, self.holder, self.calm_s = AWAY, "", 0.0
        self.scene = solid.ray_scene()
        self._exact = fcl.CollisionObject(_exact_shape(solid))
        self.T_world_part = np.eye(4)
        self._radius_mm = float(np.linalg.norm(solid.hull_mm - solid.centre_mm, axis=1).max())
        self._corners: Array | None = None

    def move(self, T_world_part: Array) -> None:
        """Note where the part is now."""
        self.T_world_part = T_world_part
        self._corners = None

    @property
    def body(self) -> int:
        """The pybullet body that represents it at present."""
        return self.carried if self.state in (HELD, PROPPED) else self.falling

    @property
    def centre_mm(self) -> Array:
        """Its centre of mass, (3,) in the world."""
        centre: Array = self.T_world_part[:3, :3] @ self.solid.centre_mm + self.T_world_part[:3, 3]
        return centre

    @property
    def corners_mm(self) -> Array:
        """The corners of its convex hull in the world, (n, 3)."""
        if self._corners is None:
            self._corners = transform(self.T_world_part, self.solid.hull_mm)
        return self._corners

    @property
    def bounds_mm(self) -> tuple[Array, Array]:
        """Its bounds in the world, exact."""
        return self.corners_mm.min(axis=0), self.corners_mm.max(axis=0)

    @property
    def lowest_mm(self) -> float:
        """Its least height."""
        return float(self.corners_mm[:, 2].min())

    @property
    def lowest_point_mm(self) -> Array:
        """The corner that is lowest, (3,)."""
        point: Array = self.corners_mm[int(np.argmin(self.corners_mm[:, 2]))]
        return point

    def is_within(self, centre_mm: Array, radius_mm: float) -> bool:
        """Return whether the part may be inside a sphere."""
        gap_mm = float(np.linalg.norm(self.centre_mm - centre_mm)) - self._radius_mm
        return gap_mm < radius_mm

    def overlaps(self, box: Box, T_world_box: Array) -> bool:
        """Return whether a box reaches into the exact mesh."""
        self._exact.setTransform(_fcl_pose(self.T_world_part))
        shape = fcl.CollisionObject(fcl.Box(*(2.0 * box.half_mm)), _fcl_pose(T_world_box, box))
        request, result = fcl.CollisionRequest(), fcl.CollisionResult()
        return bool(fcl.collide(self._exact, shape, request, result))

    def slide(self, point_mm: Array, push_mm: Array) -> None:
        """Let something push a part at rest at a point; it moves and turns on the table.

        Quasi-static, with an ellipsoid as limit surface of the friction: Lynch and Mason 1996.

        Parameters
        ----------
        point_mm : (3,) point that is pushed, world
        push_mm : (3,) distance by which the point has to yield; only its level part counts
        """
        length_mm = math.hypot(push_mm[0], push_mm[1])
        if length_mm < 1e-9:
            return
        n = push_mm[:2] / length_mm
        centre = self.centre_mm
        arm_mm = point_mm[:2] - centre[:2]
        lever_mm = float(arm_mm[0] * n[1] - arm_mm[1] * n[0])
        low, high = self.bounds_mm
        spread_mm2 = (_FRICTION_RADIUS * float(np.hypot(*(high - low)[:2]))) ** 2
        share = length_mm / (1.0 + lever_mm * lever_mm / spread_mm2)
        turn = turn_z(share * lever_mm / spread_mm2)
        T = self.T_world_part.copy()
        T[:3, :3] = turn[:3, :3] @ T[:3, :3]
        T[:3, 3] = centre + turn[:3, :3] @ (self.T_world_part[:3, 3] - centre)
        T[:2, 3] += share * n
        self.move(T)

    def watch(self, speed: tuple[float, float], dt_s: float) -> None:
        """Count the time that the part has hardly moved [mm/s, rad/s]."""
        is_slow = speed[0] < _CALM_MM_PER_S and speed[1] < _CALM_RAD_PER_S
        self.calm_s = self.calm_s + dt_s if is_slow else 0.0

    @property
    def is_calm(self) -> bool:
        """Whether it has been still for long enough to count as at rest."""
        return self.calm_s >= _CALM_S

    def rest_on_table(self) -> Array | None:
        """Return the exact pose of a part at rest on the table; None if something else bears it.

        The facet that is nearly level is put level on z = 0, about the centre of mass.
        """
        if abs(self.lowest_mm) > _SNAP_MM:
            return None
        R = self.T_world_part[:3, :3]
        down = np.array([rest.down for rest in self.solid.rests]) @ R.T
        best = down[int(np.argmin(down[:, 2]))]
        if math.acos(max(-1.0, min(1.0, -float(best[2])))) > _SNAP_RAD:
            return None
        T = np.eye(4)
        T[:3, :3] = upright(best) @ R
        T[:3, 3] = self.centre_mm - T[:3, :3] @ self.solid.centre_mm
        T[2, 3] = -float((self.solid.hull_mm @ T[2, :3]).min())
        return T


def _exact_shape(solid: Solid) -> Any:  # noqa: ANN401  (python-fcl has no types)
    shape = fcl.BVHModel()
    shape.beginModel(len(solid.vertices_mm), len(solid.faces))
    shape.addSubModel(solid.vertices_mm, solid.faces.astype(np.int64))
    shape.endModel()
    return shape


def _fcl_pose(T: Array, box: Box | None = None) -> Any:  # noqa: ANN401  (python-fcl has no types)
    position = T[:3, 3] if box is None else T[:3, :3] @ box.centre_mm + T[:3, 3]
    return fcl.Transform(T[:3, :3], position)
