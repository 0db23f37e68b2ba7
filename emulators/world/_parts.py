"""One part in the world: where it is, who has it, and whether it has come to rest."""

import math
from typing import Final

import numpy as np

from ._layout import Array
from ._poses import transform
from ._solid import Solid, upright

AWAY: Final = "away"
FALLING: Final = "falling"
LYING: Final = "lying"
HELD: Final = "held"

_CALM_MM_PER_S: Final = 3.0
_CALM_RAD_PER_S: Final = 0.05
_CALM_S: Final = 0.2
_SNAP_RAD: Final = math.radians(4.0)  # convex pieces are a little off: they tilt a lying part
_SNAP_MM: Final = 2.5


class Part:
    """A part; ``falling`` and ``carried`` are its two pybullet bodies."""

    def __init__(self, index: int, solid: Solid, falling: int, carried: int) -> None:
        self.index, self.solid = index, solid
        self.name = f"part {index}"
        self.falling, self.carried = falling, carried
        self.state, self.holder, self.calm_s = AWAY, "", 0.0
        self.scene = solid.ray_scene()
        self.T_world_part = np.eye(4)
        self._radius_mm = float(np.linalg.norm(solid.hull_mm - solid.centre_mm, axis=1).max())
        self._corners: Array | None = None

    def move(self, T_world_part: Array) -> None:
        """Note where the part is now."""
        self.T_world_part = T_world_part
        self._corners = None

    @property
    def body(self) -> int:
        """The pybullet body that stands for it at present."""
        return self.carried if self.state == HELD else self.falling

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
        """Whether the part may be inside a sphere."""
        gap_mm = float(np.linalg.norm(self.centre_mm - centre_mm)) - self._radius_mm
        return gap_mm < radius_mm

    def watch(self, speed: tuple[float, float], dt_s: float) -> None:
        """Count how long the part has hardly moved [mm/s, rad/s]."""
        is_slow = speed[0] < _CALM_MM_PER_S and speed[1] < _CALM_RAD_PER_S
        self.calm_s = self.calm_s + dt_s if is_slow else 0.0

    @property
    def is_calm(self) -> bool:
        """Whether it has lain still long enough to be left alone."""
        return self.calm_s >= _CALM_S

    def rest_on_table(self) -> Array | None:
        """Return the exact pose of a part that lies on the table; None if something else bears it.

        The facet that is nearly level is laid level on z = 0, about the centre of mass.
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
