"""Rules for a piece of surface shown well enough: incidence, resolution, depth of field."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from controller.arrays import BoolArray, FloatArray, Int32Array
from controller.imaging import Camera

from ...model import CellLayout, of_faces

PICTURE_MARGIN_PX = 12.0  # nearer to the border the hold's millimetre may carry it out


@dataclass(frozen=True, slots=True)
class VisibilityRules:
    """The camera's geometry at the station, and its demands on a surface (planning-facts.md 1.3).

    Attributes
    ----------
    distance_mm : distance from the camera to the station
    tilt_rad : angle between the camera's axis and the line to the station
    focal_px : the smaller one of both axes
    sharp_mm : depths along the axis between which the picture is sharp
    max_incidence_rad : largest angle between a surface's normal and the sight line
    min_px_per_mm : along the surface in the worse direction, foreshortening included; of every
        face, or by its id
    """

    distance_mm: float
    tilt_rad: float
    focal_px: float
    sharp_mm: tuple[float, float]
    max_incidence_rad: float
    min_px_per_mm: float | tuple[float, ...]

    @classmethod
    def of_station(
        cls,
        layout: CellLayout,
        max_incidence_deg: float,
        min_px_per_mm: float | tuple[float, ...] = 0.0,
    ) -> Self:
        """Return the rules of the inspection camera looking at a part at the station.

        Parameters
        ----------
        layout : the cell, with inspection camera and station
        max_incidence_deg : up to which a surface counts as seen
        min_px_per_mm : least resolution along the surface, of every face or by its id; 0 for any
        """
        camera = layout.inspection
        towards = layout.station_mm - camera.position_mm
        distance = float(np.linalg.norm(towards))
        along = float(towards @ camera.T_world_cam[:3, 2]) / distance
        return cls(
            distance,
            float(np.arccos(np.clip(along, -1.0, 1.0))),
            float(min(camera.K[0, 0], camera.K[1, 1])),
            layout.inspection_sharp_mm,
            float(np.radians(max_incidence_deg)),
            min_px_per_mm,
        )

    def depth_bounds_mm(self, p_com_mm: FloatArray, vectors: FloatArray) -> FloatArray:
        """Return least and greatest depth of points (n, 3) from the centre of mass: (2, v, n).

        One depth unless the camera looks past the station: then a roll of the part about the sight
        line moves its points in depth, and a direction's answer must hold for all rolls.
        """
        along = vectors @ p_com_mm.T
        middle = (self.distance_mm - along) * np.cos(self.tilt_rad)
        across = np.einsum("ij,ij->i", p_com_mm, p_com_mm) - along**2
        spread = np.sqrt(np.maximum(across, 0.0)) * np.sin(self.tilt_rad)
        return np.stack([middle - spread, middle + spread])

    def shows(self, cosine: FloatArray, depth_mm: FloatArray, face_ids: Int32Array) -> BoolArray:
        """Return a mask of the surfaces shown well enough, apart from free lines of sight.

        Parameters
        ----------
        cosine : (...) cosine of the incidence
        depth_mm : (2, ...) least and greatest depth
        face_ids : (...) face that each belongs to
        """
        return np.asarray(
            self.is_square_enough(cosine)
            & self.is_fine(cosine, depth_mm, face_ids)
            & self.is_sharp(depth_mm)
        )

    def is_square_enough(self, cosine: FloatArray) -> BoolArray:
        """Return a mask (...) of the surfaces that are not seen too flatly."""
        return np.asarray(cosine >= np.cos(self.max_incidence_rad))

    def is_fine(self, cosine: FloatArray, depth_mm: FloatArray, face_ids: Int32Array) -> BoolArray:
        """Return a mask (...) of surfaces with enough pixels to the foreshortened millimetre.

        Exact on the axis; off it a flat surface has more pixels than this estimate, by 2 % at most
        in a picture 20 degrees wide.

        Parameters
        ----------
        cosine : (...) cosine of the incidence
        depth_mm : (2, ...) least and greatest depth
        face_ids : (...) face that each belongs to
        """
        least = of_faces(self.min_px_per_mm, face_ids)
        return np.asarray(self.focal_px * cosine >= least * depth_mm[1])

    def is_sharp(self, depth_mm: FloatArray) -> BoolArray:
        """Return a mask (...) of depths within the depth of field."""
        low, high = self.sharp_mm
        return np.asarray((depth_mm[0] >= low) & (depth_mm[1] <= high))


def in_picture(camera: Camera, p_world_mm: FloatArray) -> BoolArray:
    """Return a mask (...) of world points (..., 3) in the picture, clear of its border."""
    flat = p_world_mm.reshape(-1, 3)
    pixels = camera.project(flat)
    limit = np.array(camera.size_px) - 1 - PICTURE_MARGIN_PX
    inside = np.all((pixels >= PICTURE_MARGIN_PX) & (pixels <= limit), axis=1)
    # the lens formula brings points behind the camera back into the picture
    inside &= (flat - camera.position_mm) @ camera.T_world_cam[:3, 2] > 0.0
    return np.asarray(inside.reshape(p_world_mm.shape[:-1]))
