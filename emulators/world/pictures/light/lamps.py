"""Lamps: light that a point of a surface returns towards a camera at unit level of each.

Radiance is in units of a backlight panel's middle at level 1. It adds up linearly over lamps.
A ring and a spot are flat sources of some extent that face what the lamp points at: light,
highlight and shadow are means over the same points of the source.
"""

import math
from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ...shapes import Array
from ..geometry import Array32, Scene, panel_frame

PANEL_SPILL: Final = 0.04  # share of a louvred panel's light that reaches objects before it
RING_STRENGTH: Final = 0.95
SPOT_STRENGTH: Final = 1.15
_GOLDEN: Final = (math.sqrt(5.0) - 1.0) / 2.0
_TILE_PX: Final = 16  # patterns of source points repeat after this many pixels
_OUTLINE_COUNT: Final = 12  # corners of a polygon round a source


class Source:
    """A flat source of even radiance: an annulus, or a disc.

    Its points come in patterns, each spread evenly over the source. Neighbouring pixels use
    different patterns, turned and shifted against each other, so that what a pattern leaves out
    becomes a fine grain, less than the sensor's own, and not a band.

    Parameters
    ----------
    centre_mm : (3,) in the world
    axis : (3,) axis of length 1, at right angles to the disc
    inner_mm : inner radius; 0 makes a disc of the annulus
    outer_mm : outer radius
    """

    def __init__(self, centre_mm: Array, axis: Array, inner_mm: float, outer_mm: float) -> None:
        self._centre_mm = centre_mm
        across = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        across /= np.linalg.norm(across)
        self._axes = np.stack((across, np.cross(axis, across)))
        self._inner_mm, self._outer_mm = inner_mm, outer_mm
        self._patterns: dict[int, Array32] = {}

    def outline_mm(self) -> Array:
        """Return corners of a polygon round the source, (k, 3) in the world."""
        phi = 2.0 * math.pi * np.arange(_OUTLINE_COUNT) / _OUTLINE_COUNT
        radius = self._outer_mm / math.cos(math.pi / _OUTLINE_COUNT)
        around = np.stack((np.cos(phi), np.sin(phi)), axis=1) * radius
        corners: Array = self._centre_mm + around @ self._axes
        return corners

    def points_mm(self, columns: NDArray[np.intp], rows: NDArray[np.intp], count: int) -> Array32:
        """Return points of the source for pixels, (n, count, 3) in the world.

        Parameters
        ----------
        columns, rows : (n,) the pixels [px]; neighbours get different patterns
        count : number of points that stand for the source
        """
        if count not in self._patterns:
            self._patterns[count] = self._make_patterns(count)
        of_pixels: Array32 = self._patterns[count][rows % _TILE_PX * _TILE_PX + columns % _TILE_PX]
        return of_pixels

    def _make_patterns(self, count: int) -> Array32:
        row, column = np.divmod(np.arange(_TILE_PX**2), _TILE_PX)
        # additive sequences, as `sample_offsets` has them within a pixel
        turn = (column * 0.7548776662 + row * 0.5698402910)[:, None]
        shift = (column * 0.4142135624 + row * 0.7320508076)[:, None]
        i = np.arange(count)[None]
        if self._inner_mm > 0.0:  # one sector each
            u, v = (i + turn) / count, i * _GOLDEN + shift
        else:  # a sunflower's seeds
            u, v = i * _GOLDEN + turn, (i + shift) / count
        square = self._inner_mm**2 + (v % 1.0) * (self._outer_mm**2 - self._inner_mm**2)
        phi = 2.0 * math.pi * u
        around = np.stack((np.cos(phi), np.sin(phi)), axis=-1) * np.sqrt(square)[..., None]
        around -= around.mean(axis=1, keepdims=True)  # linear light over a source: no grain
        points: Array32 = (self._centre_mm + around @ self._axes).astype(np.float32)
        return points


class Lamps:
    """All lamps of a scene, without shadows: those are in `shadows`.

    Attributes
    ----------
    sources : sources of each lamp; None for a panel, whose spill is diffuse and throws no shadow
    """

    def __init__(self, scene: Scene) -> None:
        self.lamps = scene.lamps
        self.panel_frames = [panel_frame(lamp) for lamp in scene.lamps]
        self._albedo = np.array([m.albedo for m in scene.materials], np.float32)
        self._gloss = np.array([m.gloss for m in scene.materials], np.float32)
        self._shine = np.array([m.shine for m in scene.materials], np.float32)
        self._aims = scene.aims_mm
        self.sources = [self._source(lamp) for lamp in range(len(scene.lamps))]

    def _source(self, lamp: int) -> Source | None:
        layout = self.lamps[lamp]
        aim = self._aims[lamp] - layout.centre_mm
        axis = aim / np.linalg.norm(aim)
        if layout.kind == "ring":
            half_mm = min(layout.width_mm / 2.0, layout.radius_mm)
            inner_mm, outer_mm = layout.radius_mm - half_mm, layout.radius_mm + half_mm
            return Source(layout.centre_mm, axis, inner_mm, outer_mm)
        if layout.kind == "spot":
            return Source(layout.centre_mm, axis, 0.0, layout.diameter_mm / 2.0)
        return None

    def any_source(self, lit: Iterable[int]) -> bool:
        """Return whether any of some lamps throws shadows."""
        return any(self.sources[lamp] is not None for lamp in lit)

    def from_panel(
        self,
        lamp: int,
        points_mm: Array32,
        normals: Array32,
        views: Array32,
        material: NDArray[np.int16],
        panel: NDArray[np.int16],
    ) -> Array32:
        """Return the radiance of points under a panel at level 1, (n,).

        Parameters
        ----------
        lamp : number of the lamp
        points_mm, normals : (n, 3) world; normals of length 1, towards the camera
        views : (n, 3) directions from the camera, any length
        material, panel : (n,) material and panel of the surface
        """
        to_lamp = self.lamps[lamp].centre_mm.astype(np.float32) - points_mm
        to_lamp /= _length(to_lamp)[:, None]
        spill = 0.5 + 0.5 * np.einsum("ij,ij->i", normals, to_lamp)
        light: Array32 = PANEL_SPILL * self._albedo[material] * spill
        glows = np.flatnonzero(panel == lamp)
        if len(glows):
            light[glows] = self._glow(lamp, points_mm[glows], views[glows])
        return light

    def _glow(self, lamp: int, points_mm: Array32, views: Array32) -> Array32:
        T = self.panel_frames[lamp]
        local = (points_mm - T[:3, 3].astype(np.float32)) @ T[:3, :2].astype(np.float32)
        layout = self.lamps[lamp]
        share = local / (np.array(layout.size_mm, np.float32) / 2.0)
        off = np.square(share).sum(axis=1) / 2.0
        even = 1.0 - layout.drop * off + share @ np.array(layout.slope, np.float32)
        faces_camera = views @ T[:3, 2].astype(np.float32) < 0.0
        glow: Array32 = (even * faces_camera).astype(np.float32)
        return glow

    def from_points(
        self,
        lamp: int,
        sources_mm: Array32 | None,
        points_mm: Array32,
        normals: Array32,
        views: Array32,
        material: NDArray[np.int16],
    ) -> Array32:
        """Return the radiance of points if all of a lamp's light came from single points.

        Parameters
        ----------
        lamp : number of the lamp
        sources_mm : (n, k, 3) points of the lamp for each point; None: its centre alone
        points_mm, normals, views, material : as `from_panel` has them

        Returns
        -------
        (n, k)
        """
        reflectance = self.reflectance(material)
        return self.of_points(lamp, sources_mm, points_mm, normals, views, reflectance)

    def reflectance(self, material: NDArray[np.int16]) -> tuple[Array32, Array32, Array32]:
        """Return albedo, gloss and shine of materials, (n,) each."""
        return self._albedo[material], self._gloss[material], self._shine[material]

    def of_points(
        self,
        lamp: int,
        sources_mm: Array32 | None,
        points_mm: Array32,
        normals: Array32,
        views: Array32,
        reflectance: tuple[Array32, Array32, Array32],
    ) -> Array32:
        """Return the same as `from_points` of surfaces whose material is of no list.

        Parameters
        ----------
        lamp, sources_mm, points_mm, normals, views : as `from_points` has them
        reflectance : albedo, gloss and shine, (n,) each; see `Material`
        """
        albedo, gloss, shine = reflectance
        layout = self.lamps[lamp]
        aim = self._aims[lamp] - layout.centre_mm
        reach_mm = float(np.linalg.norm(aim))
        if sources_mm is None:
            sources_mm = layout.centre_mm.astype(np.float32)[None, None]
        to_lamp = sources_mm - points_mm[:, None]
        inverse = 1.0 / _length(to_lamp)
        cosine = np.einsum("ikj,ij->ik", to_lamp, normals) * inverse
        beam = (to_lamp @ (-aim / reach_mm).astype(np.float32)) * inverse
        beam = np.square(np.maximum(beam, 0.0))
        beam *= np.square(beam)  # falls off as the sixth power of the cosine
        strength = RING_STRENGTH if layout.kind == "ring" else SPOT_STRENGTH
        beam *= np.float32(strength * reach_mm**2) * np.square(inverse)
        to_eye = -views / _length(views)[:, None]
        # Blinn's half-way direction h: n.h = (n.l + n.v) / |l + v|
        between = np.einsum("ikj,ij->ik", to_lamp, to_eye) * inverse
        facing = cosine + np.einsum("ij,ij->i", normals, to_eye)[:, None]
        mirror = np.maximum(facing, 0.0) / np.sqrt(np.maximum(2.0 + 2.0 * between, 1e-6))
        light: Array32 = albedo[:, None] * cosine + gloss[:, None] * mirror ** shine[:, None]
        light *= beam
        light[cosine <= 0.0] = 0.0
        return light


def _length(vectors: Array32) -> Array32:
    length: Array32 = np.sqrt(np.einsum("...j,...j->...", vectors, vectors))
    return np.maximum(length, np.float32(1e-9))
