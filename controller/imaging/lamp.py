"""A lamp as the points where its light comes from."""

from dataclasses import dataclass

import numpy as np

from controller.arrays import FloatArray, square_to


@dataclass(frozen=True, eq=False, slots=True)
class PointLamp:
    """A lamp as the points where its light comes from.

    Attributes
    ----------
    name : as in the cell file
    points_mm : (n, 3) in the world; a ring is a handful of points
    """

    name: str
    points_mm: FloatArray

    @staticmethod
    def ring(
        name: str, centre_mm: FloatArray, axis: FloatArray, radius_mm: float, count: int = 6
    ) -> "PointLamp":
        """Return a ring of lamps round a camera's axis.

        Parameters
        ----------
        name : as in the cell file
        centre_mm : (3,) in the world
        axis : (3,) axis of the camera, of any length
        radius_mm : radius of the ring
        count : points that stand for the ring
        """
        e1, e2 = square_to(axis)
        phi = np.arange(count) * 2 * np.pi / count
        points = centre_mm + radius_mm * (np.cos(phi)[:, None] * e1 + np.sin(phi)[:, None] * e2)
        return PointLamp(name, points)
