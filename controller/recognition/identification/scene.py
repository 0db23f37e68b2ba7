"""The pictures of one table with all that is known about it, and the limits of the search."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from controller.arrays import BoolArray, FloatArray, Grey
from controller.imaging import Camera

from ..library import Library
from ..segmentation import brightest_of

MIN_AREA_MM2 = 60.0  # smaller things are chips and dust, not parts


@dataclass(frozen=True, slots=True)
class SearchLimits:
    """Limits of the search, each with its reason.

    Attributes
    ----------
    max_coarse, max_lit : candidates fitted coarsely: to an outline, which is soon done; under
        lamps, where edges propose others
    least_met : share of its predicted outline by which a part has to meet a backlit one to be
        fitted: of 47 that fit the least was 0.98
    least_coarse : coarse score below which a backlit outline's candidate is fitted in full only
        to say what came nearest: those of right answers had 0.87 and more
    sure_coarse : coarse score from which a candidate is fitted in full at once
    max_crowded : of a backlit outline that many views are like, and none of the first ones fits
    max_fine : of the others, the best ones, if none fits perfectly
    coarse_samples : edge samples of a coarse fit: enough to tell a turn that is off
    fine_samples, fine_outline : of a full one; of one to an outline
    first_reach_mm : largest offset of a candidate: its position comes from a centroid
    edges_reach_mm : largest offset of one that edges proposed, which is fitted to them already
    after_outline_mm : largest offset under lamps once the visible outline has been fitted
    slack_mm : less than this, by which a tall part's place may be off, is in that reach already
    coarse_share : share of the best one's coarse score that others need for a full fit
    overlap_gap : overlap by which a candidate may fall short of one that fits perfectly
    perfect, perfect_px : probability from which, and misfit up to which a fit is perfect
    """

    max_coarse: int = 14
    max_lit: int = 9
    max_crowded: int = 40
    least_met: float = 0.88
    least_coarse: float = 0.7
    sure_coarse: float = 0.8
    max_fine: int = 4
    coarse_samples: int = 300
    fine_samples: int = 1000
    fine_outline: int = 600
    first_reach_mm: float = 5.0
    edges_reach_mm: float = 1.0
    after_outline_mm: float = 2.0
    slack_mm: float = 1.5
    coarse_share: float = 0.75
    overlap_gap: float = 0.025
    perfect: float = 0.9
    perfect_px: float = 0.3

    def for_crowd(self) -> "SearchLimits":
        """Return the limits for an outline that many views are like."""
        return replace(self, max_coarse=self.max_crowded)

    def for_edges(self, count: int) -> "SearchLimits":
        """Return the limits for so many candidates that are already fitted to edges."""
        reach_mm = self.edges_reach_mm
        return replace(self, max_lit=count, max_fine=count, first_reach_mm=reach_mm)


@dataclass(frozen=True, eq=False, slots=True)
class TableScene:
    """The pictures of one table, and what may lie on it.

    Attributes
    ----------
    pictures : (height, width) grey. Before a light table the backlit one last, after those under
        lamps; of several under lamps the brightest of all first
    camera : overhead, calibrated
    library : library of the possible parts, made for this camera
    is_backlit : outlines are known whole
    usable : (height, width) mask of the area for parts; None for everywhere
    search : limits of the search
    """

    pictures: Sequence[Grey]
    camera: Camera
    library: Library
    is_backlit: bool
    usable: BoolArray | None = None
    search: SearchLimits = field(default_factory=SearchLimits)

    @property
    def pixel_mm2(self) -> float:
        """Area of a pixel in the middle of the table."""
        width, height = self.camera.size_px
        ends = np.array([[width / 2, height / 2], [width / 2 + 1, height / 2 + 1]])
        here, there = self.camera.on_plane(ends)[:, :2]
        return float(np.prod(np.abs(there - here)))

    @property
    def least_px(self) -> float:
        """Pixels of the smallest thing."""
        return MIN_AREA_MM2 / self.pixel_mm2

    def mm_per_px(self, place_mm: FloatArray) -> float:
        """Return the size of a pixel at a place (2,) of the table."""
        return self.camera.mm_per_px(np.append(place_mm, 0.0))

    def seen_by(self, lit: Sequence[Grey]) -> "TableScene":
        """Return the scene as its pictures under lamps alone show it."""
        return replace(self, pictures=(brightest_of(lit), *lit), is_backlit=False)
