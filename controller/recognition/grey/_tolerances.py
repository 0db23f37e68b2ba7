"""Tolerances of the grey chain for near, straight, and round, each with its reason."""

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
        since cells of 16 px would be larger than a part's holes
    blur_px : blur of a Gaussian before Sobel
    cell_px : side of a Hough cell: an arc of 10 px radius still shows as lines in it, and a line
        across it has points enough for 2 deg
    cell_points : edge points a line of a cell has at least
    vote_rad : largest angle between a gradient and its line's normal; noise and the blur of
        crossing edges cause it
    band_px : edge points this near to a line are its own: blur and noise move them by 0.1..0.3
    straight_px : root mean square distance of a line's points; more, and it is an arc
    join_px : gap between two pieces of a line: a cell it crosses at a corner has few points
    join_rad : angle between pieces of one line: the error of a line of 6 points
    bridge_rad, bridge_px : the same, and sideways, for pieces with a larger gap between: both long
    corner_px : gap at a corner, where blur rounds the edge off
    corner_min_rad : two lines that meet at less are pieces of a curve
    line_px : shorter lines are kept as texture, not as features
    arc_px : longer lines are no pieces of an arc: one of 150 px radius shows in 40 px
    circle_px : distance of a circle's points; its centre is from cells at first
    circle_cover : part of the turn that edge points must be seen on; less is a rounded corner
    length_mm, length_ratio : of one line in picture and model: its ends are rounded off by blur;
        parts are made to 1 % and seen in perspective
    angle_rad : of one corner in both
    radius_mm, radius_ratio : of one circle in both; chamfers make doubles of a rim
    hull_ratio, hull_roundness : of the hull's width and of the ratio of its axes: walls that show
        at one place and not at another
    reach_mm : a model's edge is searched this far beside where a coarse hypothesis puts it: 3 deg
        on 30 mm
    match_mm, match_rad : the same for a fitted one: walls that the view at the table's centre
        does not show, and doubled lines, move edges by that much
    smooth_weight : weight of a smooth join beside an edge: it is visible under some lamps only
    """

    noise_factor: float = 5.0
    floor_levels: float = 3.5
    faint: float = 0.08
    fine_mm: float = 0.37
    blur_px: float = 0.8
    cell_px: float = 16.0
    cell_points: int = 5
    vote_rad: float = radians(20.0)
    band_px: float = 0.9
    straight_px: float = 0.35
    join_px: float = 8.0
    join_rad: float = radians(12.0)
    bridge_rad: float = radians(2.0)
    bridge_px: float = 0.8
    corner_px: float = 6.0
    corner_min_rad: float = radians(20.0)
    line_px: float = 9.0
    arc_px: float = 60.0
    circle_px: float = 0.9
    circle_cover: float = 0.3
    length_mm: float = 0.8
    length_ratio: float = 0.02
    angle_rad: float = radians(8.0)
    radius_mm: float = 0.4
    radius_ratio: float = 0.03
    hull_ratio: float = 0.1
    hull_roundness: float = 0.16
    reach_mm: float = 1.6
    match_mm: float = 0.7
    match_rad: float = radians(9.0)
    smooth_weight: float = 0.3
