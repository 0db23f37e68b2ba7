"""All tolerances of outlines' corners, each with its reason."""

from dataclasses import dataclass

CORNER_BOX_PX = 4.0  # shorter chords turn by the stairs of pixels
TRIM_PX = 1.0


@dataclass(frozen=True, slots=True)
class BinaryTolerances:
    """Tolerances of corners, for pixels of about a quarter mm.

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
    primitive_cost : gain that one more primitive must bring, in squared noises summed over points
    arc_cost : the same for the bend of an arc, which a straight line has not
    """

    spacing_mm: float = 0.25
    corner_box_mm: float = 2.0
    corner_turn_rad: float = 0.35
    corner_sharpness: float = 0.75
    trim_mm: float = 0.5
    line_noise_mm: float = 0.05
    primitive_cost: float = 30.0
    arc_cost: float = 15.0

    @classmethod
    def for_pixels(cls, mm_per_px: float) -> "BinaryTolerances":
        """Return the tolerances for pixels of another size, the longer side of one where oblong.

        They grow with the pixel. Pixels finer than a quarter mm change nothing, since the lens is
        then the limit.
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
        )
