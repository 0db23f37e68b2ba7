"""All tolerances of the binary chain, each with its reason."""

from dataclasses import dataclass

CORNER_BOX_PX = 4.0  # shorter chords turn by the stairs of pixels
TRIM_PX = 1.0
MIN_HOLE_PX = 6.0  # smallest hole with a shape


@dataclass(frozen=True, slots=True)
class BinaryTolerances:
    """Tolerances of boundary strings and their correlation, for pixels of about a quarter mm.

    Attributes
    ----------
    spacing_mm : spacing of boundary samples; a pixel, since anything finer is invisible
    corner_box_mm : length of the box-cars on sub-pixel loops, the chords whose turn is a corner:
        0.03 mm of noise over 2 mm turn a chord by 1 degree, and corners 2 mm apart are still two
    corner_turn_rad : a smaller turn is no corner: ten times that noise, less than the 30 degrees
        of a usual lead-in chamfer
    corner_sharpness : share of its turn a corner keeps at half the box-car's length; a sharp one
        keeps all, an arc half
    trim_mm : points this near to a corner are not fitted: the lens rounds it so far
    line_noise_mm : largest distance of points from a primitive; from noise and the rest of
        perspective
    slit_turn_rad : a corner that turns further is the end of a slit or of a sliver
    slit_mm : slits and slivers of a model narrower than this are taken away: about a pixel wide,
        they do not show in a picture, and would add twice their length to the perimeter
    primitive_cost : gain that one more primitive must bring, in squared noises summed over points
    arc_cost : the same for the bend of an arc, which a straight line has not
    corner_near_mm, corner_near_share : corners at this distance from the reference along the
        perimeter, plus this share of that distance, are compared: perspective leaves 1 to 3 %
    turn_near_rad : corners are alike up to this; the lens rounds small ones
    perimeter_share : perimeters further apart are of different shapes, or of one badly cut out
    area_share : the same of the areas of filled outlines. A tall part's shadow changes by as much
        with its turn, from what it is where the model's view was made
    point_near_mm : corners and holes at this distance after the rigid fit are matched
    hole_area_share : holes are alike up to this: walls hide part of a bore seen from the side
    min_hole_mm2 : smaller holes are light through dust, or come and go with perspective
    outline_cap_mm : samples further off the outline all count the same: dirt, a lost corner
    round_mm : an outline whose distance from its centroid varies less than this is a circle's
    keep_factor, keep_mm : matches further off than the best by this factor and this much more are
        not named: a tall part seen from elsewhere than its model is off by half a mm
    keep_per_model : turns handed on per model; equal outlines turned by 90 degrees are told
        apart by what lies inside
    """

    spacing_mm: float = 0.25
    corner_box_mm: float = 2.0
    corner_turn_rad: float = 0.35
    corner_sharpness: float = 0.75
    trim_mm: float = 0.5
    line_noise_mm: float = 0.05
    slit_turn_rad: float = 2.4
    slit_mm: float = 0.3
    primitive_cost: float = 30.0
    arc_cost: float = 15.0
    corner_near_mm: float = 1.0
    corner_near_share: float = 0.03
    turn_near_rad: float = 0.3
    perimeter_share: float = 0.2
    area_share: float = 0.2
    point_near_mm: float = 1.5
    hole_area_share: float = 0.35
    min_hole_mm2: float = 1.5
    outline_cap_mm: float = 3.0
    round_mm: float = 0.15
    keep_factor: float = 2.5
    keep_mm: float = 0.5
    keep_per_model: int = 4

    @classmethod
    def for_pixels(cls, mm_per_px: float) -> "BinaryTolerances":
        """Return the tolerances for pixels of another size, the longer side of one where oblong.

        Lengths limited by pixels grow with the pixel: spacing, chords, noise, slits, specks.
        Lengths limited by perspective stay. Pixels finer than a quarter mm change nothing, since
        the lens is then the limit.
        """
        usual = cls()
        times = max(1.0, mm_per_px / usual.spacing_mm)
        if times == 1.0:
            return usual
        return cls(
            spacing_mm=usual.spacing_mm * times,
            corner_box_mm=max(usual.corner_box_mm, CORNER_BOX_PX * mm_per_px),
            trim_mm=max(usual.trim_mm, TRIM_PX * mm_per_px),
            line_noise_mm=usual.line_noise_mm * times,
            slit_mm=usual.slit_mm * times,
            corner_near_mm=usual.corner_near_mm * max(1.0, 0.5 * times),
            min_hole_mm2=max(usual.min_hole_mm2, MIN_HOLE_PX * mm_per_px**2),
            point_near_mm=usual.point_near_mm * max(1.0, 0.5 * times),
            round_mm=usual.round_mm * times,
            keep_mm=usual.keep_mm * max(1.0, 0.5 * times),
        )
