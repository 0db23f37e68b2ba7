"""Tolerances of the grey chain for edges and their matches, each with its reason."""

from dataclasses import dataclass
from math import radians


@dataclass(frozen=True, slots=True)
class GreyTolerances:
    """Tolerances of the grey chain; `_px` is a mean pixel of the picture at hand.

    Attributes
    ----------
    noise_factor : edges are stronger than this many deviations of the Sobel of plain surface: the
        paper thresholds low, and 5 leaves no more than a point in a million to noise
    floor_levels : and stronger than a step of as many grey levels, as a picture of few levels has
        no noise to measure, only contours of its own
    faint : edges fainter than this share of the plain ones are left out: the shadow a part's own
        body throws where it touches the table has some 5 %
    fine_mm : a pixel at most about this large is asked for: a picture of larger ones is enlarged,
        since its edges would be nearer to each other than an edgelet is long
    blur_px : blur of a Gaussian before Sobel
    reach_mm : a view's edge is searched this far beside where a coarse placement puts it: 3 deg on
        30 mm
    match_mm, match_rad : the same for a fitted one: walls that the view at the table's centre
        does not show, and doubled lines, move edges by that much
    smooth_weight : weight of a smooth join beside an edge: it is visible under some lamps only
    """

    noise_factor: float = 5.0
    floor_levels: float = 3.5
    faint: float = 0.08
    fine_mm: float = 0.37
    blur_px: float = 0.8
    reach_mm: float = 1.6
    match_mm: float = 0.7
    match_rad: float = radians(9.0)
    smooth_weight: float = 0.3
