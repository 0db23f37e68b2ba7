"""Pictures by ray casting: what a camera's sensor gets, without noise; docs/adr/0003-pictures.md.

A picture is a sum over lamps. What stands still is cast once per camera and lamp; for a picture,
only the pixels that moving things or their shadows may touch are cast again, one ray each, and
those where the light jumps to the next pixel once more with many rays, so that an edge covers as
much of a pixel as it does in truth.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ._assembly import Assembly, Mover, without_own_box
from ._edges import BLOCK_PX, any_in_blocks, fine_blocks, spread
from ._layout import Array
from ._light import Lamps
from ._optics import Array32, RayTable, project
from ._scene import Scene

Index = NDArray[np.intp]
Outline = NDArray[np.int32]

JUMP: Final = 0.012  # of radiance between neighbours: 2.5 grey at unit level
SAMPLE_COUNT: Final = 48
_PIXEL_CORNERS: Final = np.array(((-1, -1), (-1, 1), (1, -1), (1, 1)), np.float32) / 2.0
_CHUNK: Final = 60_000  # rays at a time: what they need stays in the processor's cache
_MARGIN_PX: Final = 4  # the lens bends the edges of what spans the picture by less
_CORNERS: Final = ((0, 0), (0, 1), (1, 0), (1, 1))  # of a block: down, right
_FAR_PX: Final = 20_000  # where coordinates are cut off, for OpenCV's sake
_LIFT_MM: Final = 0.05  # shadow rays start off the surface by this much
_NEAR_MM: Final = 20.0


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
class _Hits:
    """What some rays met: triangle (-1: nothing), distance in lengths of the ray, where in it."""

    triangle: NDArray[np.int32]
    far: Array32
    u: Array32
    v: Array32


class Eye:
    """One camera: its rays, what it sees of what stands still, and the picture it gets."""

    def __init__(self, scene: Scene, number: int) -> None:
        self.camera = scene.cameras[number]
        self.rays = RayTable(self.camera)
        self.lamps = Lamps(scene)
        self._aims_mm = scene.aims_mm
        self._fixed = without_own_box(scene, self.camera.T_world_cam[:3, 3])
        self._movers = {surface.name: Mover(surface) for surface in scene.moving}
        self._shape = (self.camera.height_px, self.camera.width_px)
        self._layers: dict[int, Array32] = {}
        self._offsets = sample_offsets()
        self._spread = spread()
        self._origins = np.tile(self.rays.origin_mm, (_CHUNK, 1))

    def layer(self, lamp: int) -> Array32:
        """Return what the camera sees of the fixed things under one lamp at level 1, (h, w)."""
        if lamp not in self._layers:
            still = Mover(self._fixed)  # which moves from nothing to where it stands
            dark = {lamp: np.zeros(self._shape, np.float32)}
            everywhere = np.ones(self._shape, bool)
            assembly = Assembly(None, (still,))
            self._layers[lamp] = self._cast(assembly, (still,), everywhere, dark)[lamp]
        return self._layers[lamp]

    def warm_up(self) -> None:
        """Make what the first picture would wait for: the layers of lamps that point into sight."""
        pixels, depth = project(self.camera, self._aims_mm)
        inside = (pixels >= 0.0).all(axis=1) & (pixels[:, 0] < self._shape[1])
        inside &= (pixels[:, 1] < self._shape[0]) & (depth > 0.0)
        for lamp in np.flatnonzero(inside):
            self.layer(int(lamp))

    # --- pictures -------------------------------------------------------------------------------

    def picture(self, poses: Mapping[str, Array], levels: Mapping[int, float]) -> Array32:
        """Return the radiance that reaches the sensor, (h, w); a panel's middle at level 1 is 1.

        Parameters
        ----------
        poses : T_world_* of everything that moves and is there
        levels : level of each lamp that is lit, by its number
        """
        picture = np.zeros(self._shape, np.float32)
        lit = [lamp for lamp, level in levels.items() if level > 0.0]
        for lamp in lit:
            picture += np.float32(levels[lamp]) * self.layer(lamp)
        movers = self._place(poses)
        touched = np.zeros(self._shape, np.uint8)
        shaded = np.zeros(self._shape, np.uint8)
        for mover in movers.values():
            _fill(touched, self._outline(mover.corners_mm))
            for outline in self._shadow_outlines(mover, lit):
                _fill(shaded, outline)
        if not lit or not (touched.any() or shaded.any()):
            return picture
        in_play = self._in_play(movers, lit)
        assembly = Assembly(self._fixed, in_play)
        has_shadows = any(self.lamps.casts_shadows(lamp) for lamp in lit)
        wanted = (touched | shaded if has_shadows else touched).astype(bool)
        before = {lamp: self.layer(lamp).copy() for lamp in lit}
        layers = self._cast(assembly, in_play, wanted, before)
        changed = np.flatnonzero(touched | shaded)
        total = np.zeros(len(changed), np.float32)
        for lamp in lit:
            total += np.float32(levels[lamp]) * layers[lamp].reshape(-1)[changed]
        picture.reshape(-1)[changed] = total
        return picture

    def depends_on(self, poses: Mapping[str, Array], lit: Sequence[int]) -> bytes:
        """Return what a picture depends on: poses of what is in sight or throws a shadow there."""
        movers = self._place(poses)
        return b"".join(
            mover.surface.name.encode() + mover.T_world.tobytes()
            for mover in self._in_play(movers, lit)
        )

    def _in_play(self, movers: Mapping[str, Mover], lit: Sequence[int]) -> list[Mover]:
        return [
            mover
            for mover in movers.values()
            if lit
            and (self._outline(mover.corners_mm) is not None or self._may_shade(mover, movers, lit))
        ]

    def _may_shade(self, mover: Mover, movers: Mapping[str, Mover], lit: Sequence[int]) -> bool:
        """Whether a thing out of sight may stand between a lamp and something in sight."""
        if self._shadow_outlines(mover, lit):
            return True
        if not any(self.lamps.casts_shadows(lamp) for lamp in lit):
            return False
        return any(self._outline(other.corners_mm) is not None for other in movers.values())

    def _place(self, poses: Mapping[str, Array]) -> dict[str, Mover]:
        movers: dict[str, Mover] = {}
        for name, mover in self._movers.items():
            if name in poses:
                mover.place(poses[name])
                movers[name] = mover
        return movers

    def _outline(self, points_mm: Array) -> Outline | None:
        """Return the convex outline of points in the picture, (n, 2) px; None if out of it."""
        pixels, depth = project(self.camera, points_mm)
        height, width = self._shape
        if np.all(depth < _NEAR_MM):
            return None
        if np.any(depth < _NEAR_MM):  # it reaches behind the lens: anything is possible
            return np.array(((0, 0), (width, 0), (width, height), (0, height)), np.int32)
        low, high = pixels.min(axis=0) - _MARGIN_PX, pixels.max(axis=0) + _MARGIN_PX
        if high[0] < 0 or high[1] < 0 or low[0] >= width or low[1] >= height:
            return None
        near = np.clip(np.rint(pixels), -_FAR_PX, _FAR_PX).astype(np.int32)
        outline: Outline = cv2.convexHull(near)[:, 0]
        return outline

    def _shadow_outlines(self, mover: Mover, lit: Sequence[int]) -> list[Outline]:
        """Return where the shadows of a thing may fall on the table and on panels."""
        outlines = []
        for lamp in lit:
            if not self.lamps.casts_shadows(lamp):
                continue
            source = self.lamps.lamps[lamp].centre_mm
            for point, normal in self._screens():
                outline = self._shadow_outline(source, mover.corners_mm, point, normal)
                if outline is not None:
                    outlines.append(outline)
        return outlines

    def _screens(self) -> list[tuple[Array, Array]]:
        table = (np.zeros(3), np.array((0.0, 0.0, 1.0)))
        standing = [
            (lamp.centre_mm, lamp.normal)
            for lamp in self.lamps.lamps
            if lamp.kind == "panel" and abs(lamp.normal[2]) < 0.99
        ]
        return [table, *standing]

    def _shadow_outline(
        self, source: Array, corners: Array, point: Array, normal: Array
    ) -> Outline | None:
        height = (corners - point) @ normal
        lamp_height = float((source - point) @ normal)
        if lamp_height <= 0.0 or np.all(height <= 0.0):
            return None
        reach = lamp_height - np.clip(height, 0.0, None)
        if np.any(reach < 1.0):
            return None  # beside or above the lamp: its shadow runs off
        scale = (lamp_height / reach)[:, None]
        shadow = source + (corners - source) * scale
        return self._outline(shadow)

    def _cast(
        self,
        assembly: Assembly,
        in_play: Sequence[Mover],
        wanted: NDArray[np.bool_],
        layers: dict[int, Array32],
    ) -> dict[int, Array32]:
        """Return layers of lit lamps with all that moves in them, (h, w) each.

        Parameters
        ----------
        wanted : (h, w) pixels where something may have changed
        layers : as they are without what moves; changed in place
        """
        lit = list(layers)
        fresh = {lamp: np.zeros(self._shape, bool) for lamp in lit}
        crossed = fine_blocks(self._edges(in_play))
        smooth = np.argwhere(any_in_blocks(wanted) & ~crossed)
        rough = self._fill_blocks(assembly, smooth, layers, fresh)
        crossed[smooth[rough, 0], smooth[rough, 1]] = True
        closely = np.repeat(np.repeat(crossed, BLOCK_PX, axis=0), BLOCK_PX, axis=1) & wanted
        for part in _chunks(int(closely.sum()), _CHUNK):
            some = np.flatnonzero(closely)[part]
            light, is_new = self._sample(assembly, some, lit, layers)
            for lamp in lit:
                layers[lamp].reshape(-1)[some[is_new[lamp]]] = light[lamp][is_new[lamp]]
                fresh[lamp].reshape(-1)[some[is_new[lamp]]] = True
        jumps = np.zeros(self._shape, bool)
        for lamp in lit:
            jumps |= _jumps(layers[lamp], fresh[lamp])
        jumping = np.flatnonzero(jumps)
        for lamp, values in self._fine(assembly, jumping, lit).items():
            layers[lamp].reshape(-1)[jumping] = values
        return layers

    def _edges(self, in_play: Sequence[Mover]) -> NDArray[np.uint8]:
        """Return where edges of moving things may be seen, (h, w)."""
        mask = np.zeros(self._shape, np.uint8)
        for mover in in_play:
            mover.edges.draw(mask, self.camera, mover.T_world)
        return mask

    def _fill_blocks(
        self,
        assembly: Assembly,
        blocks: Index,
        layers: dict[int, Array32],
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
        lit = list(layers)
        light = {lamp: np.zeros(len(pixels), np.float32) for lamp in lit}
        is_new = {lamp: np.zeros(len(pixels), bool) for lamp in lit}
        for part in _chunks(len(pixels), _CHUNK):
            some_light, some_new = self._sample(assembly, pixels[part], lit, layers)
            for lamp in lit:
                light[lamp][part], is_new[lamp][part] = some_light[lamp], some_new[lamp]
        at = np.stack([place[blocks[:, 0] + d, blocks[:, 1] + r] for d, r in _CORNERS], axis=1)
        rough = np.zeros(len(blocks), bool)
        for lamp in lit:
            values, news = light[lamp][at], is_new[lamp][at]
            rough |= news.any(axis=1) != news.all(axis=1)
            rough |= news.all(axis=1) & (np.ptp(values, axis=1) > JUMP)
        if any(self.lamps.casts_shadows(lamp) for lamp in lit):
            rough = _with_neighbours(rough, blocks, corners.shape)
        for lamp in lit:
            good = is_new[lamp][at].all(axis=1) & ~rough
            rows, columns = blocks[good, 0], blocks[good, 1]
            values = (light[lamp][at[good]] @ self._spread).reshape(-1, BLOCK_PX, BLOCK_PX)
            folded = (height // BLOCK_PX, BLOCK_PX, width // BLOCK_PX, BLOCK_PX)
            layers[lamp].reshape(folded)[rows, :, columns] = values
            fresh[lamp].reshape(folded)[rows, :, columns] = True
        return rough

    def _sample(
        self,
        assembly: Assembly,
        pixels: Index,
        lit: Sequence[int],
        layers: Mapping[int, Array32],
    ) -> tuple[dict[int, Array32], dict[int, NDArray[np.bool_]]]:
        """Return the light in the middle of pixels, per lamp, and where it is not the layer's.

        Where something fixed is seen as before, the layer's value, finely sampled, stays.
        """
        directions = self.rays.directions[pixels]
        hits = self._meet(assembly, directions)
        moves = np.flatnonzero(hits.triangle >= assembly.fixed_count)
        on_mover = _Hits(hits.triangle[moves], hits.far[moves], hits.u[moves], hits.v[moves])
        still = (hits.triangle >= 0) & (hits.triangle < assembly.fixed_count)
        light: dict[int, Array32] = {}
        is_new: dict[int, NDArray[np.bool_]] = {}
        for lamp in lit:
            light[lamp] = layers[lamp].reshape(-1)[pixels]
            is_new[lamp] = np.zeros(len(pixels), bool)
            if self.lamps.casts_shadows(lamp):
                bright = np.flatnonzero(still & (light[lamp] > 0.0))
                points = self.rays.origin_mm + directions[bright] * hits.far[bright, None]
                normals = assembly.normals[hits.triangle[bright], 0]
                dark = bright[self._is_dark(assembly, lamp, points, normals)]
                light[lamp][dark], is_new[lamp][dark] = 0.0, True
            light[lamp][moves] = self._shade(assembly, lamp, on_mover, directions[moves])
            is_new[lamp][moves] = True
        return light, is_new

    def _fine(self, assembly: Assembly, pixels: Index, lit: Sequence[int]) -> dict[int, Array32]:
        """Return the mean radiance over pixels, per lamp, by many rays where light jumps within.

        A straight edge crosses a pixel if and only if its corners see different things.
        """
        corners = self._means(assembly, pixels, lit, _PIXEL_CORNERS)
        values = {lamp: mean for lamp, (mean, _) in corners.items()}
        crossed = np.zeros(len(pixels), bool)
        for _, spans in corners.values():
            crossed |= spans > JUMP / 2.0
        at = np.flatnonzero(crossed)
        for lamp, (mean, _) in self._means(assembly, pixels[at], lit, self._offsets).items():
            values[lamp][at] = mean
        return values

    def _means(
        self, assembly: Assembly, pixels: Index, lit: Sequence[int], offsets: Array32
    ) -> dict[int, tuple[Array32, Array32]]:
        """Return mean and span of the radiance at some points of each pixel, per lamp."""
        count = len(offsets)
        means = {lamp: np.zeros(len(pixels), np.float32) for lamp in lit}
        spans = {lamp: np.zeros(len(pixels), np.float32) for lamp in lit}
        for part in _chunks(len(pixels), _CHUNK // count):
            directions = self.rays.fractions(pixels[part], offsets)
            hits = self._meet(assembly, directions)
            for lamp in lit:
                light = self._shade(assembly, lamp, hits, directions).reshape(-1, count)
                means[lamp][part] = light.mean(axis=1)
                spans[lamp][part] = np.ptp(light, axis=1)
        return {lamp: (means[lamp], spans[lamp]) for lamp in lit}

    def _meet(self, assembly: Assembly, directions: Array32) -> _Hits:
        found = assembly.scene.run(self._origins[: len(directions)], directions, output=True)
        return _Hits(found["primID"], found["tfar"], found["u"], found["v"])

    def _shade(self, assembly: Assembly, lamp: int, hits: _Hits, directions: Array32) -> Array32:
        light = np.zeros(len(hits.far), np.float32)
        met = np.flatnonzero(hits.triangle >= 0)
        if len(met) == 0:
            return light
        triangle, views = hits.triangle[met], directions[met]
        points = self.rays.origin_mm + views * hits.far[met, None]
        if self.lamps.lamps[lamp].kind == "panel":  # its faint spill shows no curvature
            normals = assembly.normals[triangle, 0]
        else:
            corner = assembly.normals[triangle]
            u, v = hits.u[met, None], hits.v[met, None]
            normals = corner[:, 0] * (1.0 - u - v) + corner[:, 1] * u + corner[:, 2] * v
            normals /= np.sqrt(np.einsum("ij,ij->i", normals, normals))[:, None] + np.float32(1e-9)
        away = np.einsum("ij,ij->i", normals, views) > 0.0
        normals[away] = -normals[away]
        material, panel = assembly.material[triangle], assembly.panel[triangle]
        here = self.lamps.shade(lamp, points, normals, views, material, panel)
        if self.lamps.casts_shadows(lamp):
            bright = np.flatnonzero(here > 0.0)
            flat = _flat_normals(assembly, triangle[bright], views[bright])
            here[bright[self._is_dark(assembly, lamp, points[bright], flat)]] = 0.0
        light[met] = here
        return light

    def _is_dark(
        self, assembly: Assembly, lamp: int, points: Array32, normals: Array32
    ) -> NDArray[np.bool_]:
        """Return which points something keeps a lamp's light from, (n,) bool."""
        starts = points + np.float32(_LIFT_MM) * normals
        towards = self.lamps.lamps[lamp].centre_mm.astype(np.float32) - starts
        length = np.ones(len(starts), np.float32)
        met: NDArray[np.int32] = assembly.scene.run(starts, towards, length, query="OCCLUDED")
        return met >= 0


def _flat_normals(assembly: Assembly, triangle: NDArray[np.int32], views: Array32) -> Array32:
    """Return normals good enough to lift shadow rays off a surface, towards the camera."""
    normals: Array32 = assembly.normals[triangle].mean(axis=1)
    away = np.einsum("ij,ij->i", normals, views) > 0.0
    normals[away] = -normals[away]
    return normals


def _fill(mask: NDArray[np.uint8], outline: Outline | None) -> None:
    """Mark what is within an outline, and a margin that lens distortion may need."""
    if outline is not None:
        cv2.fillConvexPoly(mask, outline, 1)
        cv2.polylines(mask, [outline], isClosed=True, color=1, thickness=2 * _MARGIN_PX + 1)


def _with_neighbours(
    chosen: NDArray[np.bool_], blocks: Index, shape: tuple[int, ...]
) -> NDArray[np.bool_]:
    """Return which blocks are chosen or next to a chosen one."""
    mask = np.zeros(shape, np.uint8)
    mask[blocks[chosen, 0], blocks[chosen, 1]] = 1
    wide = cv2.dilate(mask, np.ones((3, 3), np.uint8))
    near: NDArray[np.bool_] = wide[blocks[:, 0], blocks[:, 1]] > 0
    return near


def _chunks(count: int, size: int) -> list[slice]:
    return [slice(start, min(count, start + size)) for start in range(0, count, size)]


def _jumps(values: Array32, only: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
    """Return the pixels whose light differs from a neighbour's; both sides of each jump.

    Parameters
    ----------
    only : at least one of the two neighbours must be one of these
    """
    jumps = np.zeros(values.shape, bool)
    across = np.abs(np.diff(values, axis=1)) > JUMP
    down = np.abs(np.diff(values, axis=0)) > JUMP
    if only is not None:
        across &= only[:, 1:] | only[:, :-1]
        down &= only[1:] | only[:-1]
    jumps[:, 1:] |= across
    jumps[:, :-1] |= across
    jumps[1:] |= down
    jumps[:-1] |= down
    return jumps
