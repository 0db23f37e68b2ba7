"""The light in some pixels: one ray each, many where it jumps; ADR 43.

Pixels whose light jumps to the next one get many rays, so that an edge covers as much of a pixel
as it does in truth. Blocks that no edge crosses are filled from the light at their corners.

Rings and spots have an extent. A few rays towards all parts of one decide whether a point is in
its light, in its full shadow or between; there, and next to there, many more measure how much.
Where many rays fall within a pixel each goes on to another point of the source.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..layout import CameraLayout
from .caster import Caster
from .geometry import (
    BLOCK_PX,
    Array32,
    Assembly,
    Mover,
    RayTable,
    any_in_blocks,
    fine_blocks,
    spread,
)
from .light import (
    CHUNK,
    LIFT_MM,
    Index,
    Lamps,
    Mask,
    Shadows,
    Spots,
    cast_shadows,
    chunks,
    wide_mask,
)

JUMP: Final = 0.012  # a difference in radiance between neighbours; 2.5 grey at unit level
STEEP: Final = 0.2  # the same at the border of a shadow, some pixels wide
GENTLE: Final = 0.04  # the same across a block in a border that is straight enough
SAMPLE_COUNT: Final = 48
_PIXEL_CORNERS: Final = np.array(((-1, -1), (-1, 1), (1, -1), (1, 1)), np.float32) / 2.0
_CORNERS: Final = ((0, 0), (0, 1), (1, 0), (1, 1))  # down, right within a block


def sample_offsets() -> Array32:
    """Return points that fill a pixel evenly seen from any side, (n, 2) from its centre [px].

    The R2 sequence (Roberts 2018): along rows, columns and slanted lines the points are nearly
    equidistant, where a square grid has steps of 1/8 px along its own axes.
    """
    plastic = 1.32471795724474602596  # the root of x**3 = x + 1
    i = np.arange(SAMPLE_COUNT)
    x, y = (0.5 + i / plastic) % 1.0, (0.5 + i / plastic**2) % 1.0
    points = np.stack((x, y), axis=1)
    offsets: Array32 = (points - points.mean(axis=0)).astype(np.float32)
    return offsets


@dataclass(slots=True, eq=False)
class _Seen:
    """The light of one lamp in the middle of some pixels, with and without shadows, (n,) each.

    Attributes
    ----------
    is_new : bool, whether it is another than that of the fixed things alone
    is_near : bool, whether a shadow may be there or nearby
    """

    light: Array32
    unshaded: Array32
    is_new: Mask
    is_near: Mask


class Painter:
    """Paints layers of one camera, lamp by lamp.

    Parameters
    ----------
    camera : camera whose picture it is
    rays : through its pixels
    lamps : lamps of the scene
    """

    def __init__(self, camera: CameraLayout, rays: RayTable, lamps: Lamps) -> None:
        self._camera, self._rays, self._lamps = camera, rays, lamps
        self._shape = (camera.height_px, camera.width_px)
        self._shadows = Shadows(lamps, self._shape)
        self._caster = Caster(rays.origin_mm)
        self._offsets = sample_offsets()
        self._spread = spread()

    def paint(
        self,
        assembly: Assembly,
        in_play: Sequence[Mover],
        wanted: NDArray[np.bool_],
        layers: dict[int, Array32],
    ) -> dict[int, Array32]:
        """Return layers of lit lamps with all that moves in them, (h, w) each.

        Parameters
        ----------
        assembly : all triangles, in place
        in_play : the moving things among them
        wanted : (h, w) pixels where something may have changed
        layers : as they are without what moves; changed in place
        """
        lit = list(layers)
        unshaded = {lamp: layer.copy() for lamp, layer in layers.items()}
        fresh = {lamp: np.zeros(self._shape, bool) for lamp in lit}
        crossed = fine_blocks(self.edges(in_play))
        smooth = np.argwhere(any_in_blocks(wanted) & ~crossed)
        rough = self._fill_blocks(assembly, smooth, layers, unshaded, fresh)
        crossed[smooth[rough, 0], smooth[rough, 1]] = True
        closely = np.repeat(np.repeat(crossed, BLOCK_PX, axis=0), BLOCK_PX, axis=1) & wanted
        pixels = np.flatnonzero(closely)
        spots = self._spots_at(assembly, pixels, layers)
        found = self._unshaded(spots, pixels, layers)
        for lamp, seen in found.items():
            unshaded[lamp].reshape(-1)[pixels] = seen.unshaded
            fresh[lamp].reshape(-1)[pixels] = seen.is_new
        jumps = self._jumps(unshaded, fresh, JUMP)
        fine = self._crossed(assembly, jumps, lit)
        near_shade = {lamp: np.ones(self._shape, bool) for lamp in lit}
        for lamp, seen in found.items():
            self._shade(assembly, lamp, spots, pixels, seen, fine.reshape(-1)[pixels])
            layers[lamp].reshape(-1)[pixels] = seen.light
            fresh[lamp].reshape(-1)[pixels] = seen.is_new
            near_shade[lamp].reshape(-1)[pixels] = seen.is_near
        later = self._jumps(unshaded, fresh, JUMP) & ~jumps
        fine |= self._crossed(assembly, later, lit)
        for lamp, layer in layers.items():
            known = np.where(fine, np.float32(np.nan), layer)
            fine |= _jumps(known, fresh[lamp], STEEP) & ~(jumps | later)
        self._fill_finely(assembly, np.flatnonzero(fine), layers, near_shade)
        return layers

    def _jumps(
        self, layers: Mapping[int, Array32], fresh: Mapping[int, Mask], least: float
    ) -> Mask:
        """Return a mask of the places where a lamp's light jumps at something new, (h, w)."""
        jumps = np.zeros(self._shape, bool)
        for lamp, layer in layers.items():
            jumps |= _jumps(layer, fresh[lamp], least)
        return jumps

    def edges(self, in_play: Sequence[Mover]) -> NDArray[np.uint8]:
        """Return a mask of the places where edges of moving things may be seen, (h, w)."""
        mask = np.zeros(self._shape, np.uint8)
        for mover in in_play:
            mover.edges.draw(mask, self._camera, mover.T_world)
        return mask

    def _fill_blocks(
        self,
        assembly: Assembly,
        blocks: Index,
        layers: dict[int, Array32],
        unshaded: dict[int, Array32],
        fresh: dict[int, NDArray[np.bool_]],
    ) -> NDArray[np.bool_]:
        """Fill blocks that no edge crosses from the light at their corners.

        Returns
        -------
        (n,) bool: blocks that are not smooth after all, a shadow's border for instance
        """
        height, width = self._shape
        corners = np.zeros((height // BLOCK_PX, width // BLOCK_PX), bool)
        for down, right in _CORNERS:
            corners[blocks[:, 0] + down, blocks[:, 1] + right] = True
        nodes = np.argwhere(corners)
        place = np.zeros(corners.shape, np.intp)
        place[nodes[:, 0], nodes[:, 1]] = np.arange(len(nodes))
        pixels = (nodes[:, 0] * width + nodes[:, 1]) * BLOCK_PX
        spots = self._spots_at(assembly, pixels, layers)
        nodes_seen = self._unshaded(spots, pixels, layers, BLOCK_PX)
        passed_over = np.zeros(len(pixels), bool)
        for lamp, seen in nodes_seen.items():
            self._shade(assembly, lamp, spots, pixels, seen, passed_over, BLOCK_PX)
        at = np.stack([place[blocks[:, 0] + d, blocks[:, 1] + r] for d, r in _CORNERS], axis=1)
        rough = np.zeros(len(blocks), bool)
        for seen in nodes_seen.values():
            news = seen.is_new[at]
            rough |= news.any(axis=1) != news.all(axis=1)
            rough |= news.all(axis=1) & (np.ptp(seen.unshaded[at], axis=1) > JUMP)
            rough |= news.all(axis=1) & (np.ptp(seen.light[at], axis=1) > GENTLE)
        if self._lamps.any_source(layers):
            rough = _with_neighbours(rough, blocks, corners.shape)
        folded = (height // BLOCK_PX, BLOCK_PX, width // BLOCK_PX, BLOCK_PX)
        for lamp, seen in nodes_seen.items():
            good = seen.is_new[at].all(axis=1) & ~rough
            rows, columns = blocks[good, 0], blocks[good, 1]
            for values, into in ((seen.light, layers), (seen.unshaded, unshaded)):
                inside = (values[at[good]] @ self._spread).reshape(-1, BLOCK_PX, BLOCK_PX)
                into[lamp].reshape(folded)[rows, :, columns] = inside
            fresh[lamp].reshape(folded)[rows, :, columns] = True
        return rough

    def _unshaded(
        self, spots: Spots, pixels: Index, layers: Mapping[int, Array32], step_px: int = 1
    ) -> dict[int, _Seen]:
        """Return the light in the middle of pixels, per lamp, before `_shade`.

        Where something fixed is seen as before, the layer's value, finely sampled, stays.

        Parameters
        ----------
        spots : (m,) return value of `_spots_at` for these pixels
        pixels : (n,) flat numbers, row by row
        step_px : step from a pixel to its neighbours among these
        """
        on_mover = spots.some(np.flatnonzero(spots.moves))
        at = on_mover.ray
        is_new = np.zeros(len(pixels), bool)
        is_new[at] = True
        seen = {}
        for lamp, layer in layers.items():
            light = layer.reshape(-1)[pixels]
            light[at] = self._shadows.unshaded(lamp, on_mover, pixels[at], step_px)
            is_near = np.ones(len(pixels), bool)
            seen[lamp] = _Seen(light, light.copy(), is_new.copy(), is_near)
        return seen

    def _shade(
        self,
        assembly: Assembly,
        lamp: int,
        spots: Spots,
        pixels: Index,
        seen: _Seen,
        passed_over: Mask,
        step_px: int = 1,
    ) -> None:
        """Put shadows into the light in the middle of pixels; a panel throws none.

        Parameters
        ----------
        spots : (m,) return value of `_spots_at` for these pixels
        pixels : (n,) flat numbers, row by row
        seen : as `_unshaded` returns it; changed in place
        passed_over : (n,) pixels that need not be right
        step_px : step from a pixel to its neighbours among these
        """
        if self._lamps.sources[lamp] is None:
            return
        here = spots.some(np.flatnonzero(seen.light[spots.ray] > 0.0))
        at = here.ray
        found = self._shadows.shadow(assembly, lamp, here, pixels[at], step_px, passed_over[at])
        seen.light[at[here.moves]] *= found.share[here.moves]
        new = np.flatnonzero(~here.moves & found.is_shaded)
        light = self._shadows.unshaded(lamp, here.some(new), pixels[at[new]], step_px)
        seen.light[at[new]] = found.share[new] * light
        seen.is_new[at[new]] = True
        seen.is_near[at] = found.is_near

    def _spots_at(self, assembly: Assembly, pixels: Index, layers: Mapping[int, Array32]) -> Spots:
        """Return the spots in the middle of pixels, on things that move or may be shaded."""
        directions = self._rays.directions[pixels]
        hits = self._caster.meet(assembly.scene, directions)
        told = hits.triangle >= assembly.fixed_count
        for lamp, layer in layers.items():
            if self._lamps.sources[lamp] is not None:
                told |= (hits.triangle >= 0) & (layer.reshape(-1)[pixels] > 0.0)
        return self._caster.spots(
            assembly,
            hits,
            directions,
            curved=self._lamps.any_source(layers),
            met=np.flatnonzero(told),
        )

    def _crossed(self, assembly: Assembly, among: Mask, lit: Sequence[int]) -> Mask:
        """Return a mask of the pixels that an edge crosses: their corners differ in light, (h, w).

        A straight edge crosses a pixel if and only if its corners see different things.
        """
        pixels = np.flatnonzero(among)
        crossed = np.zeros(len(pixels), bool)
        count = len(_PIXEL_CORNERS)
        for part in chunks(len(pixels), CHUNK // count):
            directions = self._rays.fractions(pixels[part], _PIXEL_CORNERS)
            hits = self._caster.meet(assembly.scene, directions)
            spots = self._caster.spots(
                assembly, hits, directions, curved=self._lamps.any_source(lit)
            )
            for lamp in lit:
                light = np.zeros(len(directions), np.float32)
                if self._lamps.sources[lamp] is None:
                    light[spots.ray] = self._shadows.from_panel(lamp, spots)
                else:
                    light[spots.ray] = self._shadows.from_points(lamp, spots, None)[:, 0]
                crossed[part] |= np.ptp(light.reshape(-1, count), axis=1) > JUMP / 2.0
        mask = np.zeros(self._shape, bool)
        mask.reshape(-1)[pixels[crossed]] = True
        return mask

    def _fill_finely(
        self,
        assembly: Assembly,
        pixels: Index,
        layers: Mapping[int, Array32],
        near_shade: Mapping[int, Mask],
    ) -> None:
        """Fill pixels with the mean of many rays.

        Each ray goes on to one point of a lamp; all rays of a pixel to points all over it.

        Parameters
        ----------
        layers : layers of each lit lamp, changed in place
        near_shade : (h, w) mask of the pixels whose rays to a lamp may meet something
        """
        count = len(self._offsets)
        mean = np.full(count, 1.0 / count, np.float32)
        for part in chunks(len(pixels), CHUNK // count):
            some = pixels[part]
            directions = self._rays.fractions(some, self._offsets)
            hits = self._caster.meet(assembly.scene, directions)
            spots = self._caster.spots(
                assembly, hits, directions, curved=self._lamps.any_source(layers)
            )
            rows, columns = np.divmod(some, self._shape[1])
            for lamp, layer in layers.items():
                light = np.zeros(len(directions), np.float32)
                source = self._lamps.sources[lamp]
                if source is None:
                    light[spots.ray] = self._shadows.from_panel(lamp, spots)
                else:
                    points_mm = source.points_mm(columns, rows, count).reshape(-1, 1, 3)[spots.ray]
                    radiance = self._shadows.from_points(lamp, spots, points_mm)
                    seen = radiance > 0.0
                    asked = seen & near_shade[lamp].reshape(-1)[some[spots.ray // count], None]
                    starts = spots.points_mm + np.float32(LIFT_MM) * spots.flat
                    cast_shadows(assembly.scene, starts, points_mm, seen, asked)
                    light[spots.ray] = (radiance * seen)[:, 0]
                layer.reshape(-1)[some] = light.reshape(-1, count) @ mean


def _with_neighbours(
    chosen: NDArray[np.bool_], blocks: Index, shape: tuple[int, ...]
) -> NDArray[np.bool_]:
    """Return a mask of the blocks that are chosen or next to a chosen one."""
    return wide_mask(blocks[chosen], shape)[blocks[:, 0], blocks[:, 1]]


def _jumps(values: Array32, only: Mask, least: float) -> Mask:
    """Return the pixels whose light differs from a neighbour's; both sides of each jump.

    Parameters
    ----------
    only : at least one of the two neighbours must be one of these
    least : least difference
    """
    jumps = np.zeros(values.shape, bool)
    across = np.abs(np.diff(values, axis=1)) > least
    down = np.abs(np.diff(values, axis=0)) > least
    across &= only[:, 1:] | only[:, :-1]
    down &= only[1:] | only[:-1]
    jumps[:, 1:] |= across
    jumps[:, :-1] |= across
    jumps[1:] |= down
    jumps[:-1] |= down
    return jumps
