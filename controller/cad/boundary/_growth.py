"""Smooth runs of facets told apart into surfaces with a formula.

A run is tried as one surface first, which settles nearly all. Where surfaces run into each other
tangentially, a surface is guessed from a few neighbouring facets and grown ring by ring as long
as corners lie on it; only what it reaches is looked at, so the work stays near n log n.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ._facets import Facets
from ._primitives import Cloud, Primitive, fits, refined

Array = NDArray[np.float64]
Ids = NDArray[np.int64]

TIGHT_MM = 0.0002  # files keep 1e-4 mm or 7 digits; a guess from a few facets has to be this good
LOOSE_MM = 0.02  # a scan, or a coarse export: a whole run that fits one surface this well
LOOSE_SHARE = 0.02  # and of its radius never more
HALF_STEP_RAD = np.radians(11.6)  # half a segment of a 16-sided rod: 17 segments are a wall
FACET_RAD = np.radians(16.0)  # a triangle of a ball or a ring, seen from its corners
LEAST_FACETS = 4  # three facets are a bevelled corner as well as a fillet
LEAST_TURN_RAD = np.radians(4.0)  # a wall that turns less has no radius worth the name
LEAST_GROWN_TURN_RAD = np.radians(15.0)  # any spline has an arc that turns less
# where surfaces intersect, kernels put corners less exactly: such walls have to turn far
SECOND_TRY = 5.0
SECOND_TURN_RAD = np.radians(45.0)
SEED_FACETS = (14, 6)
LONG_SIDE = 0.5  # of a facet's longest side: strips of a wall meet along such sides
GROWTH_ROUNDS = 12
GOLDEN = 0.6180339887498949  # its multiples spread evenly
FAILED_SEEDS = 24  # in a row: then the rest of the run has no formula
FAILED_RUNS = 400  # in a row, largest first: then the rest of the part is noise


@dataclass(frozen=True, eq=False, slots=True)
class Found:
    """A surface with the facets (k,) it is made of, and how near to it their corners lie."""

    primitive: Primitive
    facets: Ids
    tolerance_mm: float


class Neighbours:
    """Facets that meet smoothly, as rows of a compressed adjacency."""

    def __init__(self, count: int, a: Ids, b: Ids) -> None:
        key = np.unique(np.concatenate([a * count + b, b * count + a]))
        self.to: Ids = key % count
        self.start = np.searchsorted(key // count, np.arange(count + 1))

    def of(self, facets: Ids) -> Ids:
        """Return the neighbours of facets, with repeats."""
        return np.asarray(self.to[rows(self.start, facets)])


def along_long_sides(facets: Facets, inner: NDArray[np.bool_]) -> Neighbours:
    """Return the neighbours across long sides: strip by strip round a wall, not off its ends."""
    a, b, lengths = facets.a[inner], facets.b[inner], facets.lengths_mm[inner]
    longest = np.zeros(facets.count)
    np.maximum.at(longest, a, lengths)
    np.maximum.at(longest, b, lengths)
    long = lengths > LONG_SIDE * np.maximum(longest[a], longest[b])
    return Neighbours(facets.count, a[long], b[long])


def rows(start: Ids, picked: Ids) -> Ids:
    """Return the positions of all entries of picked rows of a compressed table."""
    sizes = start[picked + 1] - start[picked]
    total = int(sizes.sum())
    shift = np.repeat(start[picked] - np.concatenate([[0], np.cumsum(sizes)[:-1]]), sizes)
    return np.asarray(np.arange(total) + shift, dtype=np.int64)


class Grower:
    """Finds surfaces among the facets of one part."""

    def __init__(
        self, facets: Facets, corners: Array, is_corner: NDArray[np.bool_], tight_mm: float
    ) -> None:
        self._facets = facets
        self._corners = corners
        self._is_corner = is_corner
        self.tight_mm = max(TIGHT_MM, tight_mm)
        self._second = (SECOND_TRY * self.tight_mm, SECOND_TURN_RAD)
        self._failed_runs = 0

    def cloud(self, facets: Ids) -> Cloud:
        """Return corners and facets of a piece."""
        f = self._facets
        triangles = f.triangles[rows(f.start, facets)]
        points = self._corners[triangles][self._is_corner[triangles]]
        if len(points) == 0:
            points = self._corners[triangles].reshape(-1, 3)
        return Cloud(points, f.normals[facets], f.centres[facets], f.areas[facets])

    def is_on(self, primitive: Primitive, facets: Ids, tolerance_mm: float) -> NDArray[np.bool_]:
        """Return which facets (k,) lie on a surface: with all corners, and facing as it does."""
        f = self._facets
        at = rows(f.start, facets)
        sizes = f.start[facets + 1] - f.start[facets]
        first = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        corners = self._corners[f.triangles[at]]
        flat = ~self._is_corner[f.triangles[at]]
        off = np.where(flat, 0.0, np.abs(primitive.distances(corners))).max(axis=1)
        near = np.maximum.reduceat(off, first) <= tolerance_mm
        if primitive.kind == "plane":
            return near
        normal = np.repeat(f.normals[facets], sizes, axis=0)[:, None]
        directions = primitive.directions(corners)
        if primitive.kind in ("cylinder", "cone"):
            # a strip turns about the axis by one segment at most; its apex may turn as it likes
            limit = HALF_STEP_RAD
            axis = primitive.axis
            directions = directions - (directions @ axis)[..., None] * axis
            normal = normal - (normal @ axis)[..., None] * axis
            away = corners - primitive.centre_mm
            away = away - (away @ axis)[..., None] * axis
            moot = flat | (np.linalg.norm(away, axis=-1) < 10 * tolerance_mm)
        else:
            limit = FACET_RAD
            moot = flat
        sizes_product = np.linalg.norm(directions, axis=-1) * np.linalg.norm(normal, axis=-1)
        cosine = np.abs((directions * normal).sum(axis=-1)) / np.maximum(sizes_product, 1e-12)
        turned = np.where(moot, 1.0, cosine).min(axis=1) < np.cos(limit)
        # slivers may face anywhere; the facet's normal speaks for all its triangles
        return np.asarray(near & ~np.logical_or.reduceat(turned, first))

    def whole(self, facets: Ids) -> Found | None:
        """Return the surface a whole run of facets is, if it is one."""
        cloud = self.cloud(facets)
        some = cloud.thinned().points
        candidates = list(fits(cloud))
        for loose in (False, True):
            for primitive in candidates:
                tolerance = self.tight_mm
                if loose:
                    size = primitive.minor_radius_mm or primitive.radius_mm
                    tolerance = LOOSE_MM if size == 0 else min(LOOSE_MM, LOOSE_SHARE * size)
                    tolerance = max(tolerance, self.tight_mm)
                if float(np.abs(primitive.distances(some)).max()) > tolerance:
                    continue
                if self._is_sound(primitive, cloud) and bool(
                    self.is_on(primitive, facets, tolerance).all()
                ):
                    return Found(primitive, facets, tolerance)
        return None

    def _is_sound(
        self, primitive: Primitive, cloud: Cloud, turn_rad: float = LEAST_TURN_RAD
    ) -> bool:
        if primitive.kind == "plane":
            return True
        if len(cloud.normals) < LEAST_FACETS:
            return False
        cosine = cloud.normals @ cloud.normals[int(np.argmax(cloud.areas))]
        return bool(cosine.min() < np.cos(turn_rad))

    def run(
        self, facets: Ids, links: Neighbours, strips: Neighbours, free: NDArray[np.bool_]
    ) -> list[Found]:
        """Return the surfaces in a run of smoothly joined facets.

        ``links`` and ``strips`` are all neighbours, and those across long sides. ``free`` (m,)
        are the facets not yet on a surface; those used are marked off.
        """
        if self._failed_runs >= FAILED_RUNS:
            return []
        whole = self.whole(facets)
        if whole is not None:
            free[facets] = False
            self._failed_runs = 0
            return [whole]
        found: list[Found] = []
        for tolerance_mm, turn_rad in ((self.tight_mm, LEAST_GROWN_TURN_RAD), self._second):
            rest = facets[free[facets]]
            found += self._seeded(rest, links, strips, free, tolerance_mm, turn_rad)
        self._failed_runs = 0 if found else self._failed_runs + 1
        return found

    def _seeded(
        self,
        facets: Ids,
        links: Neighbours,
        strips: Neighbours,
        free: NDArray[np.bool_],
        tolerance_mm: float,
        turn_rad: float,
    ) -> list[Found]:
        found: list[Found] = []
        failed = 0
        by_area = facets[np.argsort(-self._facets.areas[facets], kind="stable")]
        spread = facets[np.argsort(np.arange(len(facets)) * GOLDEN % 1.0, kind="stable")]
        is_tried: dict[int, bool] = {}
        for seed in np.column_stack([by_area, spread]).ravel().tolist():
            if failed >= FAILED_SEEDS:
                break
            if not free[seed] or seed in is_tried:
                continue
            best: Found | None = None
            best_area = 0.0
            for primitive, patch in self._guesses(seed, (strips, links), free, tolerance_mm):
                grown = self._grown(primitive, patch, links, free, tolerance_mm, turn_rad)
                area = 0.0 if grown is None else float(self._facets.areas[grown.facets].sum())
                if area > 1.01 * best_area:
                    best, best_area = grown, area
            if best is None:
                failed += 1
                near = links.of(np.array([seed]))
                is_tried.update(dict.fromkeys([seed, *near.tolist()], True))
                continue
            failed = 0
            free[best.facets] = False
            found.append(best)
        return found

    def _guesses(
        self,
        seed: int,
        nearness: tuple[Neighbours, ...],
        free: NDArray[np.bool_],
        tolerance_mm: float,
    ) -> Iterator[tuple[Primitive, Ids]]:
        """Yield what a facet and some round it may be, with those facets."""
        known: list[Ids] = []
        for wanted, near in product(SEED_FACETS, nearness):
            patch = np.sort(self._patch(seed, wanted, near, free))
            if len(patch) < LEAST_FACETS or any(np.array_equal(patch, other) for other in known):
                continue
            known.append(patch)
            few = len(patch) <= LEAST_FACETS + 1
            for primitive in fits(self.cloud(patch)):
                if few and primitive.kind not in ("plane", "cylinder"):
                    break  # so few facets fit anything
                if self.is_on(primitive, patch, tolerance_mm).all():
                    yield primitive, patch
                    break  # the simplest kind that fits is the kind

    def _patch(self, seed: int, wanted: int, links: Neighbours, free: NDArray[np.bool_]) -> Ids:
        """Return a facet and the rings of facets round it, about as many as wanted."""
        patch = front = np.array([seed])
        while len(patch) < wanted:
            ring = np.unique(links.of(front))
            front = np.setdiff1d(ring[free[ring]], patch, assume_unique=True)
            if len(front) == 0:
                break
            if len(patch) + len(front) > 2 * wanted and len(patch) >= LEAST_FACETS:
                break
            patch = np.concatenate([patch, front])
        return patch

    def _grown(
        self,
        primitive: Primitive,
        patch: Ids,
        links: Neighbours,
        free: NDArray[np.bool_],
        tolerance_mm: float,
        turn_rad: float,
    ) -> Found | None:
        """Return a surface grown as far as it fits, or None if it is one by chance only."""
        facets = patch
        for _ in range(GROWTH_ROUNDS):
            size = len(facets)
            facets = self._spread(primitive, facets, links, free, tolerance_mm)
            if len(facets) == size:
                break
            if primitive.kind != "plane":
                primitive = refined(primitive, self.cloud(facets).thinned().points)
                kept = self.is_on(primitive, facets, tolerance_mm)
                if not kept[: len(patch)].all():
                    return None
                facets = facets[kept]
        cloud = self.cloud(facets)
        if primitive.kind == "plane":
            enough = len(facets) >= LEAST_FACETS
            return Found(primitive, facets, tolerance_mm) if enough else None
        if not self._is_sound(primitive, cloud, turn_rad):
            return None
        # a true arc ends where it ends; one that only osculates goes on with a wider tolerance
        wider = self._spread(primitive, facets, links, free, 8 * tolerance_mm)
        if len(wider) > 1.3 * len(facets) + 2:
            return None
        return Found(primitive, facets, tolerance_mm)

    def _spread(
        self,
        primitive: Primitive,
        facets: Ids,
        links: Neighbours,
        free: NDArray[np.bool_],
        tolerance_mm: float,
    ) -> Ids:
        seen = set(facets.tolist())
        front, parts = facets, [facets]
        while len(front):
            ring = np.unique(links.of(front))
            ring = ring[free[ring]]
            ring = np.array([i for i in ring.tolist() if i not in seen], dtype=np.int64)
            if len(ring) == 0:
                break
            seen.update(ring.tolist())
            front = ring[self.is_on(primitive, ring, tolerance_mm)]
            parts.append(front)
        return np.concatenate(parts)
