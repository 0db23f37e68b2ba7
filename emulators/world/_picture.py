"""Pictures by ray casting: what a camera's sensor gets, without noise; docs/adr/0003-pictures.md.

A picture is a sum over lamps. What stands still is cast once per camera and lamp; for a picture,
only the pixels that moving things or their shadows may touch are cast again, one ray each, and
those where the light jumps to the next pixel once more with many rays, so that an edge covers as
much of a pixel as it does in truth.

Rings and spots have an extent. A few rays towards all parts of one tell whether a point is in its
light, in its full shadow or between; there, and next to there, many more tell how much. Where many
rays fall within a pixel each goes on to another point of the source.
"""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ._assembly import Assembly, Mover, without_own_box
from ._edges import BLOCK_PX, any_in_blocks, fine_blocks, spread
from ._layout import Array
from ._light import Lamps
from ._optics import Array32, RayTable, project
from ._scene import PAINTED, Scene
from ._solid import ray_scene

Index = NDArray[np.intp]
Outline = NDArray[np.int32]
Mask = NDArray[np.bool_]

JUMP: Final = 0.012  # of radiance between neighbours: 2.5 grey at unit level
STEEP: Final = 0.2  # of radiance between neighbours: a shadow's border of a few pixels
GENTLE: Final = 0.04  # of radiance over a block of a shadow's border that is straight enough
SAMPLE_COUNT: Final = 48
PROBE_COUNT: Final = 8  # points of a source that tell whether all of it is seen
COARSE_COUNT: Final = 16  # where it is half seen, of each of some neighbours that share
PIXEL_COUNT: Final = 32  # for one pixel alone
NODE_COUNT: Final = 64  # for a block's corner, whose light many pixels share
DIFFER: Final = 0.25  # between neighbours' shares, too much for a mean
LEAN_DIFFER: Final = 0.02  # between neighbours' radiance where they lie to one side
_PIXEL_CORNERS: Final = np.array(((-1, -1), (-1, 1), (1, -1), (1, 1)), np.float32) / 2.0
_CHUNK: Final = 60_000  # rays at a time: what they need stays in the processor's cache
_MARGIN_PX: Final = 4  # the lens bends the edges of what spans the picture by less
_CORNERS: Final = ((0, 0), (0, 1), (1, 0), (1, 1))  # of a block: down, right
_FAR_PX: Final = 20_000  # where coordinates are cut off, for OpenCV's sake
_LIFT_MM: Final = 0.05  # shadow rays start off the surface by this much
_NEAR_MM: Final = 20.0
_ALIKE_COS: Final = 0.98  # of one surface's normals in neighbouring pixels
_ALIKE_MM: Final = 0.15  # off each other's plane
_SHORT_OF: Final = 0.999  # shadow rays end before the lamp, whatever it is fixed to
_HIGHEST: Final = 0.98  # of a lamp's height: what is above throws its shadow far away


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


@dataclass(slots=True, eq=False)
class _Spots:
    """Where some rays met surfaces.

    Attributes
    ----------
    ray : (n,) number of the ray
    normals, flat : (n, 3) for shading, and of the triangle; both towards the camera
    moves : (n,) bool, whether the surface is of something that moves
    """

    ray: Index
    points_mm: Array32
    normals: Array32
    flat: Array32
    views: Array32
    material: NDArray[np.int16]
    panel: NDArray[np.int16]
    moves: Mask

    def some(self, which: Index | Mask | slice) -> "_Spots":
        return _Spots(*(getattr(self, field.name)[which] for field in fields(self)))


@dataclass(slots=True, eq=False)
class _Seen:
    """The light of one lamp in the middle of some pixels, with and without shadows, (n,) each."""

    light: Array32
    unshaded: Array32
    is_new: Mask


@dataclass(slots=True, eq=False)
class _Shadow:
    """What surfaces see of a source, (n,) each.

    Attributes
    ----------
    share : of the light that would fall on them
    is_shaded, is_near : bool, whether something is hidden; whether it is there or nearby
    """

    share: Array32
    is_shaded: Mask
    is_near: Mask


@dataclass(slots=True, eq=False)
class _Lit:
    """What of a source shines on some surfaces, (n,) each.

    Attributes
    ----------
    unshaded, light : without and with what stands between
    """

    unshaded: Array32
    light: Array32

    @property
    def is_lit(self) -> Mask:
        """Whether any of it is seen."""
        return np.asarray(self.light > 0.0)

    @property
    def is_shaded(self) -> Mask:
        """Whether some of it is hidden."""
        return np.asarray(self.light < self.unshaded)

    @property
    def share(self) -> Array32:
        """The share of the light that is not kept away, 1 where there is none, (n,)."""
        known = self.unshaded > 0.0
        share = np.where(known, self.light / np.where(known, self.unshaded, 1.0), 1.0)
        return share.astype(np.float32)

    def some(self, which: Index) -> "_Lit":
        return _Lit(self.unshaded[which], self.light[which])

    def update(self, which: Index, better: "_Lit") -> None:
        """Take in what is known better of some surfaces."""
        self.unshaded[which], self.light[which] = better.unshaded, better.light


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
        self._bodies: Mask | None = None
        self._body_materials = [i for i, one in enumerate(scene.materials) if one == PAINTED]
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
        wanted = self._wanted(movers, lit)
        if not wanted.any():
            return picture
        in_play = self._in_play(movers, lit)
        assembly = Assembly(self._fixed, in_play)
        before = {lamp: self.layer(lamp).copy() for lamp in lit}
        layers = self._cast(assembly, in_play, wanted, before)
        changed = np.flatnonzero(wanted)
        total = np.zeros(len(changed), np.float32)
        for lamp in lit:
            total += np.float32(levels[lamp]) * layers[lamp].reshape(-1)[changed]
        picture.reshape(-1)[changed] = total
        return picture

    def _wanted(self, movers: Mapping[str, Mover], lit: Sequence[int]) -> Mask:
        """Return where a picture may differ from that of the fixed things, (h, w)."""
        mask = np.zeros(self._shape, np.uint8)
        for mover in movers.values() if lit else ():
            _fill(mask, self._outline(mover.corners_mm))
            for outline in self._shadow_outlines(mover, lit):
                _fill(mask, outline)
        wanted = mask.astype(bool)
        if movers and self._any_source(lit):
            wanted |= self._fixed_bodies()
        return wanted

    def _fixed_bodies(self) -> Mask:
        """Return where something fixed is seen that is neither table nor panel, (h, w)."""
        if self._bodies is None:
            is_body = np.isin(self._fixed.material, self._body_materials)
            scene = ray_scene(self._fixed.vertices_mm, self._fixed.faces, robust=False)
            bodies = np.zeros(len(self.rays.directions), bool)
            for part in _chunks(len(bodies), _CHUNK):
                hits = self._meet(scene, self.rays.directions[part])
                bodies[part] = (hits.triangle >= 0) & is_body[hits.triangle]
            wide = cv2.dilate(bodies.reshape(self._shape).astype(np.uint8), np.ones((3, 3)))
            self._bodies = wide.astype(bool)
        return self._bodies

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
        if not self._any_source(lit):
            return False
        if self._fixed_bodies().any():
            return True
        return any(self._outline(other.corners_mm) is not None for other in movers.values())

    def _any_source(self, lit: Iterable[int]) -> bool:
        """Whether any of some lamps throws shadows."""
        return any(self.lamps.sources[lamp] is not None for lamp in lit)

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
        """Return where shadows of a thing, soft borders included, may fall on table and panels."""
        outlines = []
        for lamp in lit:
            source = self.lamps.sources[lamp]
            if source is None:
                continue
            corners_mm = source.outline_mm()
            for point, normal in self._screens():
                outline = self._shadow_outline(corners_mm, mover.corners_mm, point, normal)
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
        lamp_height = float(((source - point) @ normal).min())
        between = _slab(corners, (corners - point) @ normal, _HIGHEST * lamp_height)
        if lamp_height <= 0.0 or len(between) == 0:
            return None
        height = (between - point) @ normal
        over = (source - point) @ normal
        scale = over[:, None] / (over[:, None] - height)
        shadow = source[:, None] + (between - source[:, None]) * scale[..., None]
        return self._outline(shadow.reshape(-1, 3))

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
        unshaded = {lamp: layer.copy() for lamp, layer in layers.items()}
        fresh = {lamp: np.zeros(self._shape, bool) for lamp in lit}
        crossed = fine_blocks(self._edges(in_play))
        smooth = np.argwhere(any_in_blocks(wanted) & ~crossed)
        rough = self._fill_blocks(assembly, smooth, layers, unshaded, fresh)
        crossed[smooth[rough, 0], smooth[rough, 1]] = True
        closely = np.repeat(np.repeat(crossed, BLOCK_PX, axis=0), BLOCK_PX, axis=1) & wanted
        pixels = np.flatnonzero(closely)
        spots = self._spots_at(assembly, pixels, layers)
        moving = np.flatnonzero(spots.moves)
        on_mover = spots.some(moving)
        for lamp in lit:
            new = pixels[on_mover.ray]
            unshaded[lamp].reshape(-1)[new] = self._unshaded(lamp, on_mover, new)
            layers[lamp].reshape(-1)[new] = unshaded[lamp].reshape(-1)[new]
            fresh[lamp].reshape(-1)[new] = True
        jumps = self._jumps(unshaded, fresh, JUMP)
        fine = self._crossed(assembly, jumps, lit)
        near_shade = {lamp: np.ones(self._shape, bool) for lamp in lit}
        for lamp in lit:
            if self.lamps.sources[lamp] is None:
                continue
            layer = layers[lamp].reshape(-1)
            bright = np.flatnonzero(layer[pixels[spots.ray]] > 0.0)
            here, there = spots.some(bright), pixels[spots.ray[bright]]
            found = self._shadow(assembly, lamp, here, there, 1, fine.reshape(-1)[there])
            layer[there[here.moves]] *= found.share[here.moves]
            new = np.flatnonzero(~here.moves & found.is_shaded)
            layer[there[new]] = found.share[new] * self._unshaded(lamp, here.some(new), there[new])
            fresh[lamp].reshape(-1)[there[new]] = True
            near_shade[lamp].reshape(-1)[there] = found.is_near
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
        """Return where the light of any lamp jumps at something new, (h, w)."""
        jumps = np.zeros(self._shape, bool)
        for lamp, layer in layers.items():
            jumps |= _jumps(layer, fresh[lamp], least)
        return jumps

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
        nodes_seen = self._sample(assembly, pixels, layers, BLOCK_PX)
        at = np.stack([place[blocks[:, 0] + d, blocks[:, 1] + r] for d, r in _CORNERS], axis=1)
        rough = np.zeros(len(blocks), bool)
        for seen in nodes_seen.values():
            news = seen.is_new[at]
            rough |= news.any(axis=1) != news.all(axis=1)
            rough |= news.all(axis=1) & (np.ptp(seen.unshaded[at], axis=1) > JUMP)
            rough |= news.all(axis=1) & (np.ptp(seen.light[at], axis=1) > GENTLE)
        if self._any_source(layers):
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

    def _sample(
        self,
        assembly: Assembly,
        pixels: Index,
        layers: Mapping[int, Array32],
        step_px: int = 1,
    ) -> dict[int, _Seen]:
        """Return the light in the middle of pixels, per lamp.

        Where something fixed is seen as before, the layer's value, finely sampled, stays.

        Parameters
        ----------
        pixels : (n,) flat numbers, row by row
        step_px : from a pixel to its neighbours among these
        """
        spots = self._spots_at(assembly, pixels, layers)
        moving = np.flatnonzero(spots.moves)
        on_mover = spots.some(moving)
        seen = {}
        for lamp, layer in layers.items():
            light = layer.reshape(-1)[pixels]
            is_new = np.zeros(len(pixels), bool)
            light[on_mover.ray] = self._unshaded(lamp, on_mover, pixels[on_mover.ray], step_px)
            is_new[on_mover.ray] = True
            unshaded = light.copy()
            if self.lamps.sources[lamp] is not None:
                bright = np.flatnonzero(light[spots.ray] > 0.0)
                here, there = spots.some(bright), spots.ray[bright]
                found = self._shadow(assembly, lamp, here, pixels[there], step_px)
                light[there[here.moves]] *= found.share[here.moves]
                new = np.flatnonzero(~here.moves & found.is_shaded)
                at = there[new]
                light[at] = self._unshaded(lamp, here.some(new), pixels[at], step_px)
                light[at] *= found.share[new]
                is_new[at] = True
            seen[lamp] = _Seen(light, unshaded, is_new)
        return seen

    def _spots_at(self, assembly: Assembly, pixels: Index, layers: Mapping[int, Array32]) -> _Spots:
        """Return what moves in the middle of pixels, and what is fixed and may be shaded."""
        directions = self.rays.directions[pixels]
        hits = self._meet(assembly.scene, directions)
        told = hits.triangle >= assembly.fixed_count
        for lamp, layer in layers.items():
            if self.lamps.sources[lamp] is not None:
                told |= (hits.triangle >= 0) & (layer.reshape(-1)[pixels] > 0.0)
        return self._spots(
            assembly, hits, directions, curved=self._any_source(layers), met=np.flatnonzero(told)
        )

    def _shadow(
        self,
        assembly: Assembly,
        lamp: int,
        spots: _Spots,
        pixels: Index,
        step_px: int,
        passed_over: Mask | None = None,
    ) -> _Shadow:
        """Return how much of a ring or a spot surfaces see, one in each of some pixels.

        That varies slowly over a surface, so that every other pixel in every other row is asked
        first, and pixels at a surface's rim, where shadows may be narrow. The others take the
        mean of their neighbours on the same surface, or are asked themselves where there is none,
        or where these differ. Corners of blocks are asked one by one on what moves.

        Parameters
        ----------
        step_px : from a pixel to its neighbours among these
        passed_over : (n,) pixels that need not be right, only a neighbour's guess
        """
        places = np.stack(np.divmod(pixels, self._shape[1]), axis=1) // step_px
        shape = (self._shape[0] // step_px, self._shape[1] // step_px)
        alone = spots.moves if step_px > 1 else _rims(spots, places, shape)
        is_coarse = ((places % 2) == 0).all(axis=1)
        coarse = np.flatnonzero(is_coarse)
        first = np.flatnonzero(is_coarse | alone)
        probe = self._rays_to(assembly, lamp, spots.some(first), places[first], PROBE_COUNT)
        half = (shape[0] // 2 + 1, shape[1] // 2 + 1)
        is_lit = _wide_mask(places[first[probe.is_lit]] // 2, half)
        is_near = _wide_mask(places[first[probe.is_shaded]] // 2, half)
        at = tuple((places // 2).T)
        is_near, is_partly = is_near[at], is_near[at] & is_lit[at]
        found = probe.some(np.flatnonzero(is_coarse[first]))
        partly = np.flatnonzero(is_partly[coarse])
        again = coarse[partly]
        more = self._rays_to(assembly, lamp, spots.some(again), places[again], COARSE_COUNT)
        found.update(partly, more)
        share = np.where(is_near, np.float32(0.0), np.float32(1.0))
        is_shaded = is_near.copy()
        if passed_over is not None:
            is_partly &= ~passed_over
        some = np.flatnonzero(is_partly & ~alone)
        share[some], is_shaded[some], is_open = _from_neighbours(
            spots, places, half, coarse, found, some
        )
        asked = np.append(some[is_open], np.flatnonzero(is_partly & alone))
        count = PIXEL_COUNT if step_px == 1 else NODE_COUNT
        own = self._rays_to(assembly, lamp, spots.some(asked), places[asked], count)
        share[asked], is_shaded[asked] = own.share, own.is_shaded
        return _Shadow(share, is_shaded, is_near)

    def _unshaded(self, lamp: int, spots: _Spots, pixels: Index, step_px: int = 1) -> Array32:
        """Return the light of a lamp on surfaces, one in each of some pixels, without shadows."""
        source = self.lamps.sources[lamp]
        if source is None:
            return self._from_panel(lamp, spots)
        light = np.zeros(len(pixels), np.float32)
        rows, columns = np.divmod(pixels, self._shape[1])
        mean = np.full(PROBE_COUNT, 1.0 / PROBE_COUNT, np.float32)
        for part in _chunks(len(pixels), _CHUNK // PROBE_COUNT):
            at = (columns[part] // step_px, rows[part] // step_px)
            points_mm = source.points_mm(*at, PROBE_COUNT)
            light[part] = self._from(lamp, spots.some(part), points_mm) @ mean
        return light

    def _rays_to(
        self, assembly: Assembly, lamp: int, spots: _Spots, places: Index, count: int
    ) -> _Lit:
        """Cast rays from surfaces to so many points of a lamp each."""
        source = self.lamps.sources[lamp]
        if source is None:
            raise ValueError("a panel has no shadow rays")
        total = len(places)
        unshaded, light = np.zeros(total, np.float32), np.zeros(total, np.float32)
        mean = np.full(count, 1.0 / count, np.float32)
        for part in _chunks(total, _CHUNK // count):
            here = spots.some(part)
            points_mm = source.points_mm(places[part, 1], places[part, 0], count)
            radiance = self._from(lamp, here, points_mm)
            seen = self._seen_from(assembly, here, points_mm, radiance)
            unshaded[part], light[part] = radiance @ mean, (radiance * seen) @ mean
        return _Lit(unshaded, light)

    def _seen_from(
        self, assembly: Assembly, spots: _Spots, points_mm: Array32, radiance: Array32
    ) -> NDArray[np.bool_]:
        """Return which points of a lamp light a surface, (n, k).

        On what is fixed only moving things can throw new shadows; but where one does, shadows of
        fixed things count as well, since both may take the same part of the lamp away.
        """
        seen = radiance > 0.0
        starts = spots.points_mm + np.float32(_LIFT_MM) * spots.flat
        moves = spots.moves[:, None]
        _cast_shadows(assembly.scene, starts, points_mm, seen, seen & moves)
        if not spots.moves.all():
            asked = seen & ~moves
            _cast_shadows(assembly.moving_scene, starts, points_mm, seen, asked)
            shaded = np.any(asked & ~seen, axis=1, keepdims=True)
            _cast_shadows(assembly.scene, starts, points_mm, seen, seen & shaded & ~moves)
        return seen

    def _crossed(self, assembly: Assembly, among: Mask, lit: Sequence[int]) -> Mask:
        """Return which pixels an edge crosses: their corners see different light, (h, w).

        A straight edge crosses a pixel if and only if its corners see different things.
        """
        pixels = np.flatnonzero(among)
        crossed = np.zeros(len(pixels), bool)
        count = len(_PIXEL_CORNERS)
        for part in _chunks(len(pixels), _CHUNK // count):
            directions = self.rays.fractions(pixels[part], _PIXEL_CORNERS)
            hits = self._meet(assembly.scene, directions)
            spots = self._spots(assembly, hits, directions, curved=self._any_source(lit))
            for lamp in lit:
                light = np.zeros(len(directions), np.float32)
                if self.lamps.sources[lamp] is None:
                    light[spots.ray] = self._from_panel(lamp, spots)
                else:
                    light[spots.ray] = self._from(lamp, spots, None)[:, 0]
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
        layers : of each lit lamp, changed in place
        near_shade : (h, w) where rays to a lamp may meet something
        """
        count = len(self._offsets)
        mean = np.full(count, 1.0 / count, np.float32)
        for part in _chunks(len(pixels), _CHUNK // count):
            some = pixels[part]
            directions = self.rays.fractions(some, self._offsets)
            hits = self._meet(assembly.scene, directions)
            spots = self._spots(assembly, hits, directions, curved=self._any_source(layers))
            rows, columns = np.divmod(some, self._shape[1])
            for lamp, layer in layers.items():
                light = np.zeros(len(directions), np.float32)
                source = self.lamps.sources[lamp]
                if source is None:
                    light[spots.ray] = self._from_panel(lamp, spots)
                else:
                    points_mm = source.points_mm(columns, rows, count).reshape(-1, 1, 3)[spots.ray]
                    radiance = self._from(lamp, spots, points_mm)
                    seen = radiance > 0.0
                    asked = seen & near_shade[lamp].reshape(-1)[some[spots.ray // count], None]
                    starts = spots.points_mm + np.float32(_LIFT_MM) * spots.flat
                    _cast_shadows(assembly.scene, starts, points_mm, seen, asked)
                    light[spots.ray] = (radiance * seen)[:, 0]
                layer.reshape(-1)[some] = light.reshape(-1, count) @ mean

    def _meet(self, scene: Any, directions: Array32) -> _Hits:  # noqa: ANN401  (embree has no types)
        parts = []
        for part in _chunks(len(directions), _CHUNK) or [slice(0)]:
            some = directions[part]
            parts.append(scene.run(self._origins[: len(some)], some, output=True))
        if len(parts) == 1:
            found = parts[0]
            return _Hits(found["primID"], found["tfar"], found["u"], found["v"])
        names = ("primID", "tfar", "u", "v")
        return _Hits(*(np.concatenate([one[name] for one in parts]) for name in names))

    def _spots(
        self,
        assembly: Assembly,
        hits: _Hits,
        directions: Array32,
        *,
        curved: bool,
        met: Index | None = None,
    ) -> _Spots:
        """Return the surfaces that rays met.

        Parameters
        ----------
        curved : whether normals follow curved surfaces; otherwise they are the triangles'
        met : numbers of the rays that matter; None: all that met anything
        """
        if met is None:
            met = np.flatnonzero(hits.triangle >= 0)
        triangle, views = hits.triangle[met], directions[met]
        flat = _towards_camera(assembly.flat[triangle], views)
        normals = flat
        if curved:
            corner = assembly.normals[triangle]
            u, v = hits.u[met, None], hits.v[met, None]
            normals = corner[:, 0] * (1.0 - u - v) + corner[:, 1] * u + corner[:, 2] * v
            normals /= np.sqrt(np.einsum("ij,ij->i", normals, normals))[:, None] + np.float32(1e-9)
            normals = _towards_camera(normals, views)
        return _Spots(
            met,
            self.rays.origin_mm + views * hits.far[met, None],
            normals,
            flat,
            views,
            assembly.material[triangle],
            assembly.panel[triangle],
            triangle >= assembly.fixed_count,
        )

    def _from_panel(self, lamp: int, spots: _Spots) -> Array32:
        # its faint spill shows no curvature
        return self.lamps.from_panel(
            lamp, spots.points_mm, spots.flat, spots.views, spots.material, spots.panel
        )

    def _from(self, lamp: int, spots: _Spots, points_mm: Array32 | None) -> Array32:
        return self.lamps.from_points(
            lamp, points_mm, spots.points_mm, spots.normals, spots.views, spots.material
        )


def _towards_camera(normals: Array32, views: Array32) -> Array32:
    """Return normals turned over where they point away."""
    away = np.einsum("ij,ij->i", normals, views) > 0.0
    normals[away] = -normals[away]
    return normals


def _cast_shadows(
    scene: Any,  # noqa: ANN401  (embree has no types)
    starts_mm: Array32,
    points_mm: Array32,
    seen: Mask,
    asked: Mask,
) -> None:
    """Take away from ``seen``, (n, k), what a scene hides among the pairs that are asked for.

    Parameters
    ----------
    starts_mm : (n, 3) off the surface
    points_mm : (n, k, 3) of the lamp
    """
    pairs = np.flatnonzero(asked)
    if len(pairs) == 0:
        return
    starts = starts_mm[pairs // asked.shape[1]]
    towards = points_mm.reshape(-1, 3)[pairs] - starts
    length = np.full(len(pairs), _SHORT_OF, np.float32)
    met: NDArray[np.int32] = scene.run(starts, towards, length, query="OCCLUDED")
    seen.reshape(-1)[pairs[met >= 0]] = False


def _from_neighbours(
    spots: _Spots,
    places: Index,
    shape: tuple[int, ...],
    coarse: Index,
    found: _Lit,
    some: Index,
) -> tuple[Array32, Mask, Mask]:
    """Return what is known of a source from samples in every other row and column.

    Parameters
    ----------
    places : (n, 2) rows and columns of all spots
    shape : of the grid of samples, half as many rows and columns
    coarse, found : (m,) numbers of the spots that were sampled, and what came of it
    some : (k,) numbers of the spots that are asked for

    Returns
    -------
    (k,) share of the source that is seen, (k,) bool whether part of it is hidden,
    (k,) bool whether neighbours do not tell
    """
    sample = np.full((shape[0] + 2, shape[1] + 2), -1, np.intp)
    sample[places[coarse, 0] // 2 + 1, places[coarse, 1] // 2 + 1] = np.arange(len(coarse))
    row, column = places[some, 0], places[some, 1]
    points_mm, flat, moves = spots.points_mm[some], spots.flat[some], spots.moves[some]
    light, unshaded = np.zeros(len(some), np.float32), np.zeros(len(some), np.float32)
    brightest = np.zeros(len(some), np.float32)
    least, most = np.ones(len(some), np.float32), np.zeros(len(some), np.float32)
    is_shaded = np.zeros(len(some), bool)
    lean = np.zeros((len(some), 2), np.float32)  # of the neighbours' middle off the pixel
    share = found.share
    for down, right in itertools.product((-1, 0, 1), repeat=2):
        at_row, at_column = row // 2 + down, column // 2 + right
        weight = (3 - np.abs(2 * at_row - row)) * (3 - np.abs(2 * at_column - column))
        index = sample[at_row + 1, at_column + 1]
        pair = np.flatnonzero((weight > 0) & (index >= 0))
        other = coarse[index[pair]]
        apart = np.einsum("ij,ij->i", spots.points_mm[other] - points_mm[pair], flat[pair])
        alike = np.einsum("ij,ij->i", spots.flat[other], flat[pair]) > _ALIKE_COS
        alike &= (np.abs(apart) < _ALIKE_MM) & (spots.moves[other] == moves[pair])
        pair = pair[alike]
        it, much = index[pair], weight[pair].astype(np.float32)
        light[pair] += much * found.light[it]
        unshaded[pair] += much * found.unshaded[it]
        brightest[pair] = np.maximum(brightest[pair], found.unshaded[it])
        least[pair] = np.minimum(least[pair], share[it])
        most[pair] = np.maximum(most[pair], share[it])
        is_shaded[pair] |= found.is_shaded[it]
        lean[pair, 0] += much * (2 * at_row - row)[pair]
        lean[pair, 1] += much * (2 * at_column - column)[pair]
    known = unshaded > 0.0
    span = most - least
    leans = np.any(lean != 0.0, axis=1)
    is_open = ~known | (span > DIFFER) | (leans & (span * brightest > LEAN_DIFFER))
    mean = np.where(known, light / np.where(known, unshaded, 1.0), 1.0).astype(np.float32)
    return mean, is_shaded, is_open


def _rims(spots: _Spots, places: Index, shape: tuple[int, ...]) -> Mask:
    """Return which of some pixels have a neighbour that is off their surface's plane, (n,)."""
    number = np.full((shape[0] + 1, shape[1] + 1), -1, np.int32)
    number[places[:, 0], places[:, 1]] = np.arange(len(places), dtype=np.int32)
    rims = np.zeros(len(places), bool)
    for down, right in ((0, 1), (1, 0)):
        other = number[places[:, 0] + down, places[:, 1] + right]
        one = np.flatnonzero(other >= 0)
        other = other[one]
        apart = spots.points_mm[other] - spots.points_mm[one]
        off = np.abs(np.einsum("ij,ij->i", apart, spots.flat[one])) > _ALIKE_MM
        rims[one[off]] = True
        rims[other[off]] = True
    return rims


def _wide_mask(places: Index, shape: tuple[int, ...]) -> Mask:
    """Return a mask of places, rows and columns, and those next to them."""
    mask = np.zeros(shape, np.uint8)
    mask[places[:, 0], places[:, 1]] = 1
    wide: Mask = np.asarray(cv2.dilate(mask, np.ones((3, 3), np.uint8)), bool)
    return wide


def _slab(corners: Array, height: Array, highest: float) -> Array:
    """Return corners that bound what of a convex thing is between height 0 and the highest."""
    for sign, limit in ((1.0, highest), (-1.0, 0.0)):
        over = sign * (height - limit)
        inside, outside = np.flatnonzero(over <= 0.0), np.flatnonzero(over > 0.0)
        i, o = (one.ravel() for one in np.meshgrid(inside, outside))
        share = (over[i] / (over[i] - over[o]))[:, None]
        cut = corners[i] * (1.0 - share) + corners[o] * share
        corners = np.concatenate((corners[inside], cut))
        height = np.concatenate((height[inside], np.full(len(cut), limit)))
    return corners


def _fill(mask: NDArray[np.uint8], outline: Outline | None) -> None:
    """Mark what is within an outline, and a margin that lens distortion may need."""
    if outline is not None:
        cv2.fillConvexPoly(mask, outline, 1)
        cv2.polylines(mask, [outline], isClosed=True, color=1, thickness=2 * _MARGIN_PX + 1)


def _with_neighbours(
    chosen: NDArray[np.bool_], blocks: Index, shape: tuple[int, ...]
) -> NDArray[np.bool_]:
    """Return which blocks are chosen or next to a chosen one."""
    return _wide_mask(blocks[chosen], shape)[blocks[:, 0], blocks[:, 1]]


def _chunks(count: int, size: int) -> list[slice]:
    return [slice(start, min(count, start + size)) for start in range(0, count, size)]


def _jumps(values: Array32, only: Mask, least: float) -> Mask:
    """Return the pixels whose light differs from a neighbour's; both sides of each jump.

    Parameters
    ----------
    only : at least one of the two neighbours must be one of these
    least : by which they differ
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
