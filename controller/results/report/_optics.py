"""Pixel sizes, and pixels of positions on the table, from the cell data."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import ValidationError

from controller.config import Cell
from controller.setup.optics import build_camera

ARROW_MM = 25.0


class Optics:
    """Two calibrated cameras of a run.

    Attributes
    ----------
    table_mm_per_px, station_mm_per_px : pixel size on the table, and at the station
    """

    def __init__(self, cell: Cell) -> None:
        self._overhead = build_camera(cell.cameras.overhead)
        station = np.array(cell.station.position, dtype=float)
        self.station_mm_per_px = build_camera(cell.cameras.inspection).mm_per_px(station)
        (x0, x1), (y0, y1) = cell.table.glowing_area.x, cell.table.glowing_area.y
        middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2, 0.0])
        self.table_mm_per_px = self._overhead.mm_per_px(middle)

    @classmethod
    def of(cls, cell: Mapping[str, Any]) -> "Optics | None":
        """Return the optics of a journaled cell; None if this version cannot read it."""
        try:
            return cls(Cell.model_validate(cell))
        except ValidationError:
            return None

    def arrow_px(self, x_mm: float, y_mm: float, theta_deg: float) -> tuple[float, ...]:
        """Return the ends x0, y0, x1, y1 of an arrow on the table, in the overhead picture.

        The arrow begins at the sighting's position and points along the part's x axis, turned by
        theta.

        Parameters
        ----------
        x_mm, y_mm : position of the sighting on the table, world
        theta_deg : rotation of the sighting about +z
        """
        theta = np.radians(theta_deg)
        tip = (x_mm + ARROW_MM * np.cos(theta), y_mm + ARROW_MM * np.sin(theta))
        pixels = self._overhead.project(np.array([[x_mm, y_mm, 0.0], [*tip, 0.0]]))
        return tuple(float(v) + 0.5 for v in pixels.ravel())
