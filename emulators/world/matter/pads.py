"""The pads' contact with a part: height fields of the exact mesh, and the part's seat between.

Everything is in the TCP frame of a gripper: x approach, y the jaws' axis, origin between the
finger tips. The pads are ``opening`` apart and close symmetrically.
"""

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ..layout import Fingers
from ..poses import invert
from ..shapes import Array

_GRID_MM: Final = 1.0  # pitch of the height field; on a radius of 30 mm it misses 4 um of the crest
_BACK_MM: Final = 2.0  # rays start behind the pad's face, where a part that is pressed in would be
_TOUCH_MM: Final = 0.15  # compression of rubber: surface this near the crest carries load
_SEAT_STEP_RAD: Final = math.radians(2.0)  # largest turn in one linear step
# a part more crooked than this jams and is held as it stands
MAX_SEAT_RAD: Final = math.radians(4.0)
_LEVELS: Final = 9  # levels, each a third as wide as the last: down to 1e-4 of the step
_SIDE: Final = 9  # candidates per level and angle
_REGULAR_MM_PER_RAD: Final = 0.01  # preference for the less turned of two equally narrow seats


@dataclass(frozen=True, slots=True, eq=False)
class Felt:
    """The surface of a part before the pads.

    Attributes
    ----------
    upper_mm, lower_mm : (n,) y of the surface seen from the pad on +y, on -y; nan where none
    """

    upper_mm: Array
    lower_mm: Array

    @property
    def is_between(self) -> bool:
        """Whether there is material in front of both pads."""
        return bool(np.isfinite(self.upper_mm).sum() >= 3 and np.isfinite(self.lower_mm).sum() >= 3)

    def gaps_mm(self, opening_mm: float) -> tuple[float, float]:
        """Return each pad's distance from the part, +y first; negative when pressed in."""
        half = opening_mm / 2.0
        return half - float(np.nanmax(self.upper_mm)), float(np.nanmin(self.lower_mm)) + half


@dataclass(frozen=True, slots=True, eq=False)
class Seat:
    """The seat of a part between closed pads.

    Attributes
    ----------
    T_tcp_part : where
    opening_mm : opening of the jaws then
    area_mm2 : contact area, of the pad that has less
    centre_mm : (3,) middle of the touching surface, TCP frame
    shift_mm, turn_rad : motion of the part that led there
    """

    T_tcp_part: Array
    opening_mm: float
    area_mm2: float
    centre_mm: Array
    shift_mm: float
    turn_rad: float


class Pads:
    """The two pads of a gripper."""

    def __init__(self, fingers: Fingers) -> None:
        # the whole inner face: what stands higher than the pads stops a straight finger as well
        nx = max(2, round(fingers.length_mm / _GRID_MM))
        nz = max(2, round(fingers.width_mm / _GRID_MM))
        x = -(np.arange(nx) + 0.5) * fingers.length_mm / nx
        z = ((np.arange(nz) + 0.5) / nz - 0.5) * fingers.width_mm
        gx, gz = np.meshgrid(x, z, indexing="ij")
        self._x, self._z = gx.ravel(), gz.ravel()
        self._cell_mm2 = fingers.length_mm * fingers.width_mm / (nx * nz)
        self._pivot_mm = np.array((-fingers.pad_length_mm / 2.0, 0.0, 0.0))

    def feel(self, scene: Any, T_tcp_part: Array, opening_mm: float) -> Felt:  # noqa: ANN401
        """Return the distances from the pads to a part whose embree scene is ``scene``.

        Parameters
        ----------
        scene : embree scene of the part, in the part frame [mm]
        T_tcp_part : (4, 4) pose of the part in the TCP frame [mm]
        opening_mm : distance between the pads
        """
        T_part_tcp = invert(T_tcp_part)
        start_mm = opening_mm / 2.0 + _BACK_MM
        upper = self._heights(scene, T_part_tcp, start_mm)
        return Felt(upper, self._heights(scene, T_part_tcp, -start_mm))

    def is_seen(self, scene: Any, T_tcp_part: Array, opening_mm: float) -> bool:  # noqa: ANN401
        """Return whether any of a part is in front of the pad on +y, where `feel` would see it.

        Parameters
        ----------
        scene, T_tcp_part, opening_mm : as of `feel`
        """
        start_mm = opening_mm / 2.0 + _BACK_MM
        return bool(np.isfinite(self._heights(scene, invert(T_tcp_part), start_mm)).any())

    def push(self, felt: Felt, opening_mm: float) -> tuple[Array, float] | None:
        """Return the point (3,) and push along y [mm] of the deeper finger; None if neither pushes.

        Positive pushes towards +y: the finger on -y does that.
        """
        upper_mm, lower_mm = felt.gaps_mm(opening_mm)
        if min(upper_mm, lower_mm) >= 0.0:
            return None
        if upper_mm < lower_mm:
            touching = felt.upper_mm > np.nanmax(felt.upper_mm) - _TOUCH_MM
            y, push_mm = opening_mm / 2.0, upper_mm
        else:
            touching = felt.lower_mm < np.nanmin(felt.lower_mm) + _TOUCH_MM
            y, push_mm = -opening_mm / 2.0, -lower_mm
        point = np.array((self._x[touching].mean(), y, self._z[touching].mean()))
        return point, push_mm

    def _heights(self, scene: Any, T_part_tcp: Array, start_mm: float) -> Array:  # noqa: ANN401
        origins = np.column_stack((self._x, np.full(len(self._x), start_mm), self._z))
        origins = origins @ T_part_tcp[:3, :3].T + T_part_tcp[:3, 3]
        sign = math.copysign(1.0, start_mm)
        direction = -sign * T_part_tcp[:3, 1]
        directions = np.broadcast_to(direction.astype(np.float32), origins.shape)
        hit = scene.run(origins.astype(np.float32), np.ascontiguousarray(directions), output=True)
        y = start_mm - sign * hit["tfar"].astype(float)
        # what lies beyond the other pad is not between the jaws
        seen = (hit["primID"] >= 0) & (sign * y > -abs(start_mm))
        heights: Array = np.where(seen, y, np.nan)
        return heights

    def seat(self, scene: Any, T_tcp_part: Array, opening_mm: float) -> Seat:  # noqa: ANN401
        """Return the final seat of a part as the jaws close on it: the nearest least opening.

        The part turns about the pads' x and z until it is flush (or a limit is met) and moves
        along y to the middle: both fingers move alike. About y nothing turns it.

        Parameters
        ----------
        scene : embree scene of the part, in the part frame [mm]
        T_tcp_part : (4, 4) pose of the part in the TCP frame before the jaws close [mm]
        opening_mm : distance between the pads then
        """
        T = T_tcp_part.copy()
        turned = np.zeros(2)
        for _ in range(4):
            felt = self.feel(scene, T, opening_mm)
            if not felt.is_between:
                break
            step = self._flush(felt, turned)
            turned += step
            T = self._turned(T, step)
            if np.abs(step).max() < 1e-5:
                break
        felt = self.feel(scene, T, opening_mm)
        if not felt.is_between:  # it has turned out of reach: hold it where it was
            T, turned = T_tcp_part.copy(), np.zeros(2)
            felt = self.feel(scene, T, opening_mm)
        top, bottom = float(np.nanmax(felt.upper_mm)), float(np.nanmin(felt.lower_mm))
        middle = (top + bottom) / 2.0
        on_upper, on_lower = felt.upper_mm > top - _TOUCH_MM, felt.lower_mm < bottom + _TOUCH_MM
        T[1, 3] -= middle
        both = np.concatenate((np.flatnonzero(on_upper), np.flatnonzero(on_lower)))
        centre = np.array((self._x[both].mean(), 0.0, self._z[both].mean()))
        return Seat(
            T_tcp_part=T,
            opening_mm=max(0.0, top - bottom),
            area_mm2=float(min(on_upper.sum(), on_lower.sum())) * self._cell_mm2,
            centre_mm=centre,
            shift_mm=abs(middle),
            turn_rad=float(np.hypot(*turned)),
        )

    def _flush(self, felt: Felt, turned: Array) -> Array:
        """Return the turn about (x, z) [rad] that lets the jaws close furthest, to first order.

        Surface at (x, y, z) comes to y - rx z + rz x, so the opening is a convex function of the
        two angles; a grid that zooms in finds its least value.
        """
        up, low = np.isfinite(felt.upper_mm), np.isfinite(felt.lower_mm)
        x, z = self._x - self._pivot_mm[0], self._z
        best, half = np.zeros(2), _SEAT_STEP_RAD
        offsets = np.linspace(-1.0, 1.0, _SIDE)
        grid = np.stack(np.meshgrid(offsets, offsets, indexing="ij"), axis=-1).reshape(-1, 2)
        for _ in range(_LEVELS):
            tries = np.clip(best + half * grid, -MAX_SEAT_RAD - turned, MAX_SEAT_RAD - turned)
            rx, rz = tries[:, 0, None], tries[:, 1, None]
            top = (felt.upper_mm[up] - rx * z[up] + rz * x[up]).max(axis=1)
            bottom = (felt.lower_mm[low] - rx * z[low] + rz * x[low]).min(axis=1)
            cost = top - bottom + _REGULAR_MM_PER_RAD * np.hypot(*(tries + turned).T)
            best = tries[int(np.argmin(cost))]
            half /= 3.0
        return best

    def _turned(self, T_tcp_part: Array, turn: Array) -> Array:
        rx, rz = float(turn[0]), float(turn[1])
        cx, sx, cz, sz = math.cos(rx), math.sin(rx), math.cos(rz), math.sin(rz)
        R = np.array(((cz, -sz, 0.0), (sz, cz, 0.0), (0.0, 0.0, 1.0))) @ np.array(
            ((1.0, 0.0, 0.0), (0.0, cx, -sx), (0.0, sx, cx))
        )
        pivot = self._pivot_mm
        T = np.eye(4)
        T[:3, :3] = R @ T_tcp_part[:3, :3]
        T[:3, 3] = R @ (T_tcp_part[:3, 3] - pivot) + pivot
        return T
