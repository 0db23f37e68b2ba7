"""Smooth runs of facets divided into surfaces with a formula.

A run is tried as one surface first, which is enough for nearly all. Where surfaces meet
tangentially, a surface is guessed from a few neighbouring facets and grown ring by ring as long as
corners lie on it; only the facets it reaches are examined, so the work stays near n log n.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, IntArray

from ..formulas.fits import Cloud, fits
from ..formulas.primitives import Primitive
from ..formulas.refine import refined
from ._neighbours import SmoothNeighbours
from ._pieces import MIN_FACETS, Pieces

LOOSE_MM = 0.02  # misfit up to which a whole run of a scan or a coarse export is one surface
LOOSE_SHARE = 0.02  # largest misfit of that run as a share of its radius
MIN_TURN_RAD = np.radians(4.0)  # a wall that turns less has no reliable radius
MIN_GROWN_TURN_RAD = np.radians(15.0)  # any spline has an arc that turns less
# Tolerance of a second try, in first ones: kernels place corners less exactly where surfaces
# intersect. Such walls have to turn far.
SECOND_TRY = 5.0
SECOND_TURN_RAD = np.radians(45.0)
SEED_FACETS = (14, 6)
GROWTH_ROUNDS = 12
GOLDEN = 0.6180339887498949  # golden ratio, whose multiples are spread evenly
FAILED_SEEDS = 24  # failures in a row after which the rest of the run has no formula
MIN_SEEDS = 4  # least number of such failures, where nearly all runs have failed so far
# Failed runs that reduce `FAILED_SEEDS` to a half, twice as many to a third, and so on.
TIRING_RUNS = 20
FAILED_RUNS = 200  # failed runs, largest first, after which the rest of the part counts as noise
MAX_SEEDS = 10_000  # seeds tried in a part: seven times the need of the largest drawn part at hand
CHANCE_RUNS = 3  # failed runs for each good one, as in noise: by chance some noise fits a ball


@dataclass(frozen=True, eq=False, slots=True)
class Found:
    """A surface with its facets (k,), and the distance of their corners from it."""

    primitive: Primitive
    facets: IntArray
    tolerance_mm: float


class Grower:
    """Finds surfaces among the facets of one part, and tallies the runs that had none.

    Parameters
    ----------
    pieces : pieces of the part
    max_seeds : facets that surfaces are grown from at most; then only whole runs are tried
    """

    def __init__(self, pieces: Pieces, max_seeds: int = MAX_SEEDS) -> None:
        self._pieces = pieces
        self._seeds_left = max_seeds
        self._second = (SECOND_TRY * self._pieces.tight_mm, SECOND_TURN_RAD)
        self._failed_runs = self._good_runs = 0

    @property
    def is_spent(self) -> bool:
        """True if no seeds are left, so that surfaces with a formula may count as free-form."""
        return self._seeds_left <= 0

    def whole(self, facets: IntArray) -> Found | None:
        """Return the surface of a whole run of facets, or None."""
        cloud = self._pieces.cloud(facets)
        some = cloud.thinned().points
        candidates = list(fits(cloud))
        for loose in (False, True):
            for primitive in candidates:
                tolerance = self._pieces.tight_mm
                if loose:
                    size = primitive.minor_radius_mm or primitive.radius_mm
                    tolerance = LOOSE_MM if size == 0 else min(LOOSE_MM, LOOSE_SHARE * size)
                    tolerance = max(tolerance, self._pieces.tight_mm)
                if float(np.abs(primitive.distances(some)).max()) > tolerance:
                    continue
                if self._is_sound(primitive, cloud) and bool(
                    self._pieces.is_on(primitive, facets, tolerance).all()
                ):
                    return Found(primitive, facets, tolerance)
        return None

    def _is_sound(self, primitive: Primitive, cloud: Cloud, turn_rad: float = MIN_TURN_RAD) -> bool:
        if primitive.kind == "plane":
            return True
        if len(cloud.normals) < MIN_FACETS:
            return False
        cosine = cloud.normals @ cloud.normals[int(np.argmax(cloud.areas))]
        return bool(cosine.min() < np.cos(turn_rad))

    def run(
        self, facets: IntArray, links: SmoothNeighbours, strips: SmoothNeighbours, free: BoolArray
    ) -> list[Found]:
        """Return the surfaces in a run of smoothly joined facets.

        The search stops once nearly all runs before have failed.

        Parameters
        ----------
        facets : (k,) the run
        links : all neighbours of each facet of the part
        strips : those across long sides only
        free : (m,) mask of the facets that are on no surface yet; used ones are marked in place
        """
        if self._failed_runs >= max(FAILED_RUNS, CHANCE_RUNS * self._good_runs):
            return []
        whole = self.whole(facets)
        if whole is not None:
            free[facets] = False
            self._good_runs += 1
            return [whole]
        found: list[Found] = []
        for tolerance_mm, turn_rad in ((self._pieces.tight_mm, MIN_GROWN_TURN_RAD), self._second):
            rest = facets[free[facets]]
            found += self._seeded(rest, links, strips, free, tolerance_mm, turn_rad)
        self._good_runs += bool(found)
        self._failed_runs += not found
        return found

    def _seeded(
        self,
        facets: IntArray,
        links: SmoothNeighbours,
        strips: SmoothNeighbours,
        free: BoolArray,
        tolerance_mm: float,
        turn_rad: float,
    ) -> list[Found]:
        found: list[Found] = []
        areas = self._pieces.facets.areas
        failed, patience = 0, FAILED_SEEDS
        if self._failed_runs > CHANCE_RUNS * self._good_runs:
            # one run after the other has no formula: rather a scan than a drawn part
            patience = max(MIN_SEEDS, FAILED_SEEDS // (1 + self._failed_runs // TIRING_RUNS))
        by_area = facets[np.argsort(-areas[facets], kind="stable")]
        spread = facets[np.argsort(np.arange(len(facets)) * GOLDEN % 1.0, kind="stable")]
        is_tried: dict[int, bool] = {}
        for seed in np.column_stack([by_area, spread]).ravel().tolist():
            if failed >= patience:
                break
            if not free[seed] or seed in is_tried:
                continue
            if self.is_spent:
                break
            self._seeds_left -= 1
            best: Found | None = None
            best_area = 0.0
            known: list[IntArray] = []
            for primitive, patch in self._guesses(seed, (strips, links), free, tolerance_mm, known):
                grown = self._grown(primitive, patch, links, free, tolerance_mm, turn_rad)
                area = 0.0 if grown is None else float(areas[grown.facets].sum())
                if grown is not None and area > 1.01 * best_area:
                    best, best_area = grown, area
                    known.append(grown.facets)
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
        nearness: tuple[SmoothNeighbours, ...],
        free: BoolArray,
        tolerance_mm: float,
        known: list[IntArray],
    ) -> Iterator[tuple[Primitive, IntArray]]:
        """Yield candidate surfaces of a facet and some round it, with those facets.

        Facets that are already ``known`` are skipped; the caller may add to them.
        """
        tried: list[IntArray] = []
        for near in nearness:
            patches = [self._pieces.patch(seed, wanted, near, free) for wanted in SEED_FACETS]
            # what does not fit a few facets will not fit more of them
            few = self._guess(patches[1], tolerance_mm)
            if few is None and len(patches[1]) > MIN_FACETS + 1:
                continue
            for patch in patches:
                if len(patch) < MIN_FACETS or any(self._pieces.is_within(patch, p) for p in known):
                    continue
                if any(len(patch) == len(p) and self._pieces.is_within(patch, p) for p in tried):
                    continue
                tried.append(patch)
                primitive = few if patch is patches[1] else self._guess(patch, tolerance_mm)
                if primitive is not None:
                    yield primitive, patch

    def _guess(self, patch: IntArray, tolerance_mm: float) -> Primitive | None:
        """Return the simplest kind of surface that fits a few facets."""
        if len(patch) < MIN_FACETS:
            return None
        cloud = self._pieces.cloud(patch)
        few = len(patch) <= MIN_FACETS + 1
        for primitive in fits(cloud, tolerance_mm):
            if few and primitive.kind not in ("plane", "cylinder"):
                return None  # so few facets fit anything
            if float(np.abs(primitive.distances(cloud.points)).max()) > tolerance_mm:
                continue
            if self._pieces.is_on(primitive, patch, tolerance_mm).all():
                return primitive
        return None

    def _grown(
        self,
        primitive: Primitive,
        patch: IntArray,
        links: SmoothNeighbours,
        free: BoolArray,
        tolerance_mm: float,
        turn_rad: float,
    ) -> Found | None:
        """Return a surface grown as far as it fits, None for a chance fit."""
        facets = patch
        for _ in range(GROWTH_ROUNDS):
            size = len(facets)
            facets = self._pieces.spread(primitive, facets, links, free, tolerance_mm)
            if len(facets) == size:
                break
            if primitive.kind != "plane":
                primitive = refined(primitive, self._pieces.cloud(facets).thinned().points)
                kept = self._pieces.is_on(primitive, facets, tolerance_mm)
                if not kept[: len(patch)].all():
                    return None
                facets = facets[kept]
        if len(facets) < MIN_FACETS:
            return None
        if not self._is_sound(primitive, self._pieces.cloud(facets), turn_rad):
            return None
        # a true arc ends where it ends; one that only osculates goes on with a wider tolerance
        wider = self._pieces.spread(primitive, facets, links, free, 8 * tolerance_mm)
        if len(wider) > 1.3 * len(facets) + 2:
            return None
        return Found(primitive, facets, tolerance_mm)
