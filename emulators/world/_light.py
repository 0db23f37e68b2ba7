"""Lamps: what unit level of each gives back from a point of a surface, towards a camera.

Radiance is in units of a glowing panel's middle at level 1. It adds up linearly over lamps.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ._optics import Array32
from ._scene import Scene, panel_frame

PANEL_DROP: Final = 0.10  # darker at the corners by this fraction
PANEL_SPILL: Final = 0.04  # of a louvred panel's light reaches what stands before it
RING_STRENGTH: Final = 0.95
SPOT_STRENGTH: Final = 1.15
_BEAM_POWER: Final = 6.0


class Lamps:
    """All lamps of a scene; shadows are the caller's matter."""

    def __init__(self, scene: Scene) -> None:
        self.lamps = scene.lamps
        self.panel_frames = [panel_frame(lamp) for lamp in scene.lamps]
        self._albedo = np.array([m.albedo for m in scene.materials], np.float32)
        self._gloss = np.array([m.gloss for m in scene.materials], np.float32)
        self._shine = np.array([m.shine for m in scene.materials], np.float32)
        self._aims = scene.aims_mm

    def casts_shadows(self, lamp: int) -> bool:
        """Whether a lamp is small and off the camera's axis; a ring's shadows hide."""
        return self.lamps[lamp].kind == "spot"

    def shade(
        self,
        lamp: int,
        points_mm: Array32,
        normals: Array32,
        views: Array32,
        material: NDArray[np.int16],
        panel: NDArray[np.int16],
    ) -> Array32:
        """Return the radiance of points under one lamp at level 1, (n,).

        Parameters
        ----------
        points_mm, normals : (n, 3) world; normals of length 1, towards the camera
        views : (n, 3) directions from the camera, any length
        material, panel : (n,) of the surface
        """
        layout = self.lamps[lamp]
        albedo = self._albedo[material]
        if layout.kind == "panel":
            to_lamp = layout.centre_mm.astype(np.float32) - points_mm
            to_lamp /= _length(to_lamp)
            spill = 0.5 + 0.5 * np.einsum("ij,ij->i", normals, to_lamp)
            light: Array32 = PANEL_SPILL * albedo * spill
            glows = np.flatnonzero(panel == lamp)
            if len(glows):
                light[glows] = self._glow(lamp, points_mm[glows], views[glows])
            return light
        return self._lit(lamp, points_mm, normals, views, albedo, material)

    def _glow(self, lamp: int, points_mm: Array32, views: Array32) -> Array32:
        T = self.panel_frames[lamp]
        local = (points_mm - T[:3, 3].astype(np.float32)) @ T[:3, :2].astype(np.float32)
        half = np.array(self.lamps[lamp].size_mm, np.float32) / 2.0
        off = (np.square(local / half)).sum(axis=1) / 2.0
        faces_camera = views @ T[:3, 2].astype(np.float32) < 0.0
        glow: Array32 = ((1.0 - PANEL_DROP * off) * faces_camera).astype(np.float32)
        return glow

    def _lit(
        self,
        lamp: int,
        points_mm: Array32,
        normals: Array32,
        views: Array32,
        albedo: Array32,
        material: NDArray[np.int16],
    ) -> Array32:
        layout = self.lamps[lamp]
        aim = self._aims[lamp] - layout.centre_mm
        reach_mm = float(np.linalg.norm(aim))
        to_lamp = layout.centre_mm.astype(np.float32) - points_mm
        distance_mm = _length(to_lamp)
        to_lamp /= distance_mm
        cosine = np.maximum(np.einsum("ij,ij->i", normals, to_lamp), 0.0)
        beam = np.maximum(-(to_lamp @ (aim / reach_mm).astype(np.float32)), 0.0) ** _BEAM_POWER
        strength = RING_STRENGTH if layout.kind == "ring" else SPOT_STRENGTH
        power = strength * beam * np.square(reach_mm / distance_mm[:, 0])
        half = to_lamp - views / _length(views)
        half /= _length(half)
        mirror = np.maximum(np.einsum("ij,ij->i", normals, half), 0.0)
        gloss = self._gloss[material] * mirror ** self._shine[material] * (cosine > 0.0)
        light: Array32 = (power * (albedo * cosine + gloss)).astype(np.float32)
        return light


def _length(vectors: Array32) -> Array32:
    length: Array32 = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))[:, None]
    return np.maximum(length, np.float32(1e-9))
