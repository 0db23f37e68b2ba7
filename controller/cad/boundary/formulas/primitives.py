"""Planes, cylinders, cones, spheres and tori: the surfaces that have a formula."""

from dataclasses import dataclass

import numpy as np

from controller.arrays import FloatArray

from .._normals import unit
from .._types import FaceKind

TINY_MM = 1e-12  # smallest divisor, in place of a length of zero


@dataclass(frozen=True, eq=False, slots=True)
class Primitive:
    """A surface with a formula; the fields have the meaning of those of `Face`."""

    kind: FaceKind
    centre_mm: FloatArray
    axis: FloatArray
    radius_mm: float = 0.0
    minor_radius_mm: float = 0.0
    half_angle_rad: float = 0.0

    def distances(self, points: FloatArray) -> FloatArray:
        """Return the signed distances of points (..., 3) from the surface."""
        offset = points - self.centre_mm
        if self.kind == "sphere":
            return np.asarray(np.sqrt((offset * offset).sum(axis=-1)) - self.radius_mm)
        height = offset @ self.axis
        if self.kind == "plane":
            return np.asarray(height)
        away = np.sqrt(np.maximum((offset * offset).sum(axis=-1) - height**2, 0.0))
        away = away - self.radius_mm
        if self.kind == "cylinder":
            return np.asarray(away)
        if self.kind == "cone":
            return np.asarray(
                away * np.cos(self.half_angle_rad) - height * np.sin(self.half_angle_rad)
            )
        return np.asarray(np.hypot(away, height) - self.minor_radius_mm)

    def directions(self, points: FloatArray) -> FloatArray:
        """Return unit normals (..., 3) at points, away from the axis or centre."""
        if self.kind == "plane":
            return np.broadcast_to(self.axis, points.shape)
        offset = points - self.centre_mm
        if self.kind == "sphere":
            return unit(offset)
        height = (offset @ self.axis)[..., None]
        radial = unit(offset - height * self.axis)
        if self.kind == "cylinder":
            return radial
        if self.kind == "cone":
            return np.asarray(
                radial * np.cos(self.half_angle_rad) - self.axis * np.sin(self.half_angle_rad)
            )
        return unit(offset - radial * self.radius_mm)

    def seen_from(
        self, points: FloatArray, normals: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return distances of points (..., 3), agreement of normals, and distances from the axis.

        The agreement is the size of the cosine between a normal (..., 3) and the surface's; of
        cylinders and cones about the axis only. The distances are unsigned, and so is the last.
        """
        offset = points - self.centre_mm
        height = offset @ self.axis
        if self.kind == "plane":
            return np.abs(height), np.abs(normals @ self.axis), np.abs(height)
        if self.kind == "sphere":
            away = np.sqrt((offset * offset).sum(axis=-1))
            cosine = np.abs((offset * normals).sum(axis=-1)) / np.maximum(away, TINY_MM)
            return np.abs(away - self.radius_mm), cosine, away
        radial = offset - height[..., None] * self.axis
        away = np.sqrt((radial * radial).sum(axis=-1))
        safe = np.maximum(away, TINY_MM)
        along_axis = normals @ self.axis
        out = (radial * normals).sum(axis=-1) / safe
        if self.kind == "torus":
            tube = np.hypot(away - self.radius_mm, height)
            cosine = np.abs(out * (away - self.radius_mm) + along_axis * height)
            return np.abs(tube - self.minor_radius_mm), cosine / np.maximum(tube, TINY_MM), away
        cosine = np.abs(out) / np.sqrt(np.maximum(1.0 - along_axis**2, TINY_MM))
        off = away - self.radius_mm
        if self.kind == "cone":
            off = off * np.cos(self.half_angle_rad) - height * np.sin(self.half_angle_rad)
        return np.abs(off), cosine, away
