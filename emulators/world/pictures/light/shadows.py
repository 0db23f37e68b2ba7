"""The visible share of a ring or a spot lamp: few shadow rays on even surfaces, many at borders.

Knows lamps and the objects between, no camera: surfaces come one in each of some pixels, and only
their neighbourhood matters.
"""

import itertools
from dataclasses import dataclass, fields
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry import Array32, Assembly
from .lamps import Lamps

Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

PROBE_COUNT: Final = 8  # points of a source, enough to know whether all of it is seen
COARSE_COUNT: Final = 16  # points of a partly seen source, for each of some neighbours that share
PIXEL_COUNT: Final = 32  # points for a single pixel
NODE_COUNT: Final = 64  # points for a block's corner, whose light many pixels share
DIFFER: Final = 0.25  # largest difference of neighbours' shares for a mean
LEAN_DIFFER: Final = 0.02  # largest difference of neighbours' radiance if they lie to one side
CHUNK: Final = 60_000  # rays at a time, so that their data stay in the processor's cache
LIFT_MM: Final = 0.05  # distance of a shadow ray's start from the surface
_ALIKE_COS: Final = 0.98  # least cosine between one surface's normals in neighbouring pixels
_ALIKE_MM: Final = 0.15  # largest distance of neighbouring points from each other's plane
_SHORT_OF: Final = 0.999  # share at which shadow rays end, before the lamp and its mount


@dataclass(slots=True, eq=False)
class Spots:
    """The surface points that some rays met.

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

    def some(self, which: Index | Mask | slice) -> "Spots":
        """Return those chosen by number, mask or range."""
        return Spots(*(getattr(self, field.name)[which] for field in fields(self)))


@dataclass(slots=True, eq=False)
class Shadow:
    """The surfaces' view of a source, (n,) each.

    Attributes
    ----------
    share : share of the light that would fall on them
    is_shaded, is_near : bool, whether something is hidden; whether it is there or nearby
    """

    share: Array32
    is_shaded: Mask
    is_near: Mask


@dataclass(slots=True, eq=False)
class Lit:
    """The light of a source on some surfaces, (n,) each.

    Attributes
    ----------
    unshaded, light : without and with what stands between
    """

    unshaded: Array32
    light: Array32

    @property
    def is_lit(self) -> Mask:
        """Whether any of the source's light arrives, (n,)."""
        return np.asarray(self.light > 0.0)

    @property
    def is_shaded(self) -> Mask:
        """Whether something keeps some of the light away, (n,)."""
        return np.asarray(self.light < self.unshaded)

    @property
    def share(self) -> Array32:
        """The share of the light that arrives, 1 if there is none, (n,)."""
        known = self.unshaded > 0.0
        share = np.where(known, self.light / np.where(known, self.unshaded, 1.0), 1.0)
        return share.astype(np.float32)

    def some(self, which: Index) -> "Lit":
        """Return the light of the surfaces with these numbers."""
        return Lit(self.unshaded[which], self.light[which])

    def update(self, which: Index, better: "Lit") -> None:
        """Replace the light of some surfaces by a better estimate."""
        self.unshaded[which], self.light[which] = better.unshaded, better.light


class Shadows:
    """The light of a scene's lamps on surfaces, with and without the objects in between.

    Parameters
    ----------
    shape : (height, width) shape of the picture whose pixels the surfaces are in
    """

    def __init__(self, lamps: Lamps, shape: tuple[int, int]) -> None:
        self._lamps, self._shape = lamps, shape

    def shadow(
        self,
        assembly: Assembly,
        lamp: int,
        spots: Spots,
        pixels: Index,
        step_px: int,
        passed_over: Mask,
    ) -> Shadow:
        """Return the share of a ring or a spot lamp that surfaces see, one in each of some pixels.

        The light varies slowly over a surface, so that every other pixel in every other row is
        computed first, and pixels at a surface's rim, where shadows may be narrow. The others take
        the mean of their neighbours on the same surface, or are computed themselves if there are
        none, or if these differ. Corners of blocks on moving objects are computed one by one.

        Parameters
        ----------
        assembly : solids between lamp and surfaces
        lamp : number of the lamp
        spots : (n,) points where the rays met surfaces, one for each pixel
        pixels : (n,) the pixels, row by row: v times the width plus u
        step_px : step from a pixel to its neighbours among these
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
        is_lit = wide_mask(places[first[probe.is_lit]] // 2, half)
        is_near = wide_mask(places[first[probe.is_shaded]] // 2, half)
        at = tuple((places // 2).T)
        is_near, is_partly = is_near[at], is_near[at] & is_lit[at]
        found = probe.some(np.flatnonzero(is_coarse[first]))
        partly = np.flatnonzero(is_partly[coarse])
        again = coarse[partly]
        more = self._rays_to(assembly, lamp, spots.some(again), places[again], COARSE_COUNT)
        found.update(partly, more)
        share = np.where(is_near, np.float32(0.0), np.float32(1.0))
        is_shaded = is_near.copy()
        is_partly &= ~passed_over
        some = np.flatnonzero(is_partly & ~alone)
        share[some], is_shaded[some], is_open = _from_neighbours(
            spots, places, half, coarse, found, some
        )
        asked = np.append(some[is_open], np.flatnonzero(is_partly & alone))
        count = PIXEL_COUNT if step_px == 1 else NODE_COUNT
        own = self._rays_to(assembly, lamp, spots.some(asked), places[asked], count)
        share[asked], is_shaded[asked] = own.share, own.is_shaded
        return Shadow(share, is_shaded, is_near)

    def unshaded(self, lamp: int, spots: Spots, pixels: Index, step_px: int = 1) -> Array32:
        """Return the light of a lamp on surfaces, one in each of some pixels, without shadows.

        Parameters
        ----------
        lamp : number of the lamp
        spots : (n,) points where the rays met surfaces, one for each pixel
        pixels : (n,) the pixels, row by row: v times the width plus u
        step_px : distance of neighbours among the pixels

        Returns
        -------
        (n,) radiance
        """
        source = self._lamps.sources[lamp]
        if source is None:
            return self.from_panel(lamp, spots)
        light = np.zeros(len(pixels), np.float32)
        rows, columns = np.divmod(pixels, self._shape[1])
        mean = np.full(PROBE_COUNT, 1.0 / PROBE_COUNT, np.float32)
        for part in chunks(len(pixels), CHUNK // PROBE_COUNT):
            at = (columns[part] // step_px, rows[part] // step_px)
            points_mm = source.points_mm(*at, PROBE_COUNT)
            light[part] = self.from_points(lamp, spots.some(part), points_mm) @ mean
        return light

    def _rays_to(
        self, assembly: Assembly, lamp: int, spots: Spots, places: Index, count: int
    ) -> Lit:
        """Cast rays from each surface to a number of points of a lamp."""
        source = self._lamps.sources[lamp]
        if source is None:
            raise ValueError("a panel has no shadow rays")
        total = len(places)
        unshaded, light = np.zeros(total, np.float32), np.zeros(total, np.float32)
        mean = np.full(count, 1.0 / count, np.float32)
        for part in chunks(total, CHUNK // count):
            here = spots.some(part)
            points_mm = source.points_mm(places[part, 1], places[part, 0], count)
            radiance = self.from_points(lamp, here, points_mm)
            seen = self._seen_from(assembly, here, points_mm, radiance)
            unshaded[part], light[part] = radiance @ mean, (radiance * seen) @ mean
        return Lit(unshaded, light)

    def _seen_from(
        self, assembly: Assembly, spots: Spots, points_mm: Array32, radiance: Array32
    ) -> NDArray[np.bool_]:
        """Return a mask of the lamp points that light each surface, (n, k).

        On fixed objects only moving ones can throw new shadows; but where one does, shadows of
        fixed objects count as well, since both may hide the same part of the lamp.
        """
        seen = radiance > 0.0
        starts = spots.points_mm + np.float32(LIFT_MM) * spots.flat
        moves = spots.moves[:, None]
        cast_shadows(assembly.scene, starts, points_mm, seen, seen & moves)
        if not spots.moves.all():
            asked = seen & ~moves
            cast_shadows(assembly.moving_scene, starts, points_mm, seen, asked)
            shaded = np.any(asked & ~seen, axis=1, keepdims=True)
            cast_shadows(assembly.scene, starts, points_mm, seen, seen & shaded & ~moves)
        return seen

    def from_panel(self, lamp: int, spots: Spots) -> Array32:
        """Return the radiance of surfaces under a panel, (n,); a panel throws no shadow."""
        # its faint spill shows no curvature
        return self._lamps.from_panel(
            lamp, spots.points_mm, spots.flat, spots.views, spots.material, spots.panel
        )

    def from_points(self, lamp: int, spots: Spots, points_mm: Array32 | None) -> Array32:
        """Return the radiance of points if all of a lamp's light came from single points.

        Parameters
        ----------
        lamp : number of the lamp
        spots : (n,) points where the rays met surfaces
        points_mm : (n, k, 3) points of the lamp for each of them; None: its centre alone

        Returns
        -------
        (n, k) radiance
        """
        return self._lamps.from_points(
            lamp, points_mm, spots.points_mm, spots.normals, spots.views, spots.material
        )


def chunks(count: int, size: int) -> list[slice]:
    """Return ranges that cover ``count`` things, at most ``size`` each."""
    return [slice(start, min(count, start + size)) for start in range(0, count, size)]


def cast_shadows(
    scene: Any,  # noqa: ANN401  (embree has no types)
    starts_mm: Array32,
    points_mm: Array32,
    seen: Mask,
    asked: Mask,
) -> None:
    """Clear in ``seen``, (n, k), the requested pairs that a scene hides from each other.

    Parameters
    ----------
    scene : embree scene of what may stand between, in the frame of the points
    starts_mm : (n, 3) off the surface
    points_mm : (n, k, 3) points of the lamp
    seen : (n, k) bool, changed in place
    asked : (n, k) bool, the pairs that a ray is cast for
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
    spots: Spots,
    places: Index,
    shape: tuple[int, ...],
    coarse: Index,
    found: Lit,
    some: Index,
) -> tuple[Array32, Mask, Mask]:
    """Return the light of a source, estimated from samples in every other row and column.

    Parameters
    ----------
    places : (n, 2) rows and columns of all spots
    shape : shape of the grid of samples, half as many rows and columns
    coarse, found : (m,) numbers of the spots that were sampled, and what came of it
    some : (k,) numbers of the spots that are asked for

    Returns
    -------
    (k,) share of the source that is seen, (k,) bool whether part of it is hidden,
    (k,) bool whether neighbours cannot decide
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


def _rims(spots: Spots, places: Index, shape: tuple[int, ...]) -> Mask:
    """Return a mask of the pixels with a neighbour off their surface's plane, (n,)."""
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


def wide_mask(places: Index, shape: tuple[int, ...]) -> Mask:
    """Return a mask of places, rows and columns, and those next to them."""
    mask = np.zeros(shape, np.uint8)
    mask[places[:, 0], places[:, 1]] = 1
    wide: Mask = np.asarray(cv2.dilate(mask, np.ones((3, 3), np.uint8)), bool)
    return wide
