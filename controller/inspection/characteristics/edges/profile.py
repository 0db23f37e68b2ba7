"""Lines of sight that show the edges of a plane in profile, where its level can be measured.

A level is measured where a camera looks more or less along the plane, so that an edge is seen
against the background. Rays along such lines of sight show whether the part itself is in the way;
the planner considers gripper and cell.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.cad import Solid
from controller.imaging.rays import RayCaster

from .._types import EdgeLine, Rim

AZIMUTH_COUNT: Final = 16
ELEVATIONS_RAD: Final = np.radians(
    [-15.0, 0.0, 15.0]
)  # at this angle a change of level still moves its edge by 97 %
# Distance from the edge at which rays start, more than the rounding errors of meshes and rays.
OFF_MM: Final = 0.05
MIN_SHARE: Final = 0.6  # least share of an edge in sight
MIN_RIM_SHARE: Final = 0.2  # least share of a rim in sight: the portion that faces the camera
# Cosine of the least angle between an edge and the line of sight, which foreshortens the edge.
ALONG_COS: Final = float(np.cos(np.radians(30.0)))
STEPS: Final = np.linspace(0.1, 0.9, 5)
RIM_STEPS: Final = np.linspace(0.0, 1.0, 24, endpoint=False)


class Profile:
    """Lines of sight nearly square to a direction, all round it."""

    def __init__(self, solid: Solid, direction: FloatArray, caster: RayCaster) -> None:
        least = np.eye(3)[int(np.abs(direction).argmin())]
        u = np.cross(direction, least)
        u = u / np.linalg.norm(u)
        v = np.cross(direction, u)
        turns = np.arange(AZIMUTH_COUNT) * 2 * np.pi / AZIMUTH_COUNT
        flat = np.outer(np.cos(turns), u) + np.outer(np.sin(turns), v)
        self._sights: FloatArray = np.concatenate(
            [np.cos(e) * flat + np.sin(e) * direction for e in ELEVATIONS_RAD]
        )
        self._normals = np.array([face.normal for face in solid.faces])
        self._caster = caster

    def of_line(self, line: EdgeLine) -> BoolArray:
        """Return a mask (s,) of the lines of sight that show a straight edge."""
        along = line.end_mm - line.start_mm
        points = line.start_mm + STEPS[:, None] * along
        outward = self._normals[list(line.faces)].sum(axis=0)
        outward = outward / max(float(np.linalg.norm(outward)), 1e-9)
        share = self._in_sight(points + OFF_MM * outward)
        along = along / np.linalg.norm(along)
        return (share >= MIN_SHARE) & (np.abs(self._sights @ along) < ALONG_COS)

    def of_rim(self, rim: Rim) -> BoolArray:
        """Return a mask (s,) of the lines of sight that show an outer rim."""
        across = np.cross(rim.axis, rim.start)
        turns = (RIM_STEPS * rim.sweep_rad)[:, None]
        radial = np.cos(turns) * rim.start + np.sin(turns) * across
        points = rim.centre_mm + rim.radius_mm * radial + OFF_MM * (radial + rim.axis)
        return self._in_sight(points) >= MIN_RIM_SHARE

    def of_plane(self, lines: Sequence[EdgeLine], rims: Sequence[Rim]) -> BoolArray:
        """Return a mask (s,) of the lines of sight that show any edge of a plane."""
        shown = [self.of_line(line) for line in lines] + [self.of_rim(rim) for rim in rims]
        return np.any(shown, axis=0) if shown else np.zeros(len(self._sights), dtype=bool)

    def _in_sight(self, points: FloatArray) -> FloatArray:
        """Return the visible share of points along each line of sight (s,)."""
        count = len(points)
        origins = np.tile(points, (len(self._sights), 1))
        blocked = self._caster.blocked(origins, np.repeat(self._sights, count, axis=0))
        return np.asarray(1.0 - blocked.reshape(-1, count).mean(axis=1))
