"""The outline in a picture before the backlight panel, and the uncertainty of its points."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from scipy.special import ndtr

from controller.arrays import BoolArray, Float32Array, Grey
from controller.imaging import (
    Contour,
    fit_ground,
    sample_picture,
    subpixel_contour,
    threshold_levels,
)
from controller.imaging.levels import pixel_noise
from controller.recognition.fitting import OutlineMeasure

from .._connected import grow
from .._scene import ViewScene

REDUCED: Final = 4  # reduction of the picture for the panel's own light, which changes slowly
BESIDE_PX: Final = 8  # width beside a part in which blur and light hide the panel's level
SATURATED: Final = 256  # a level that none exceeds: a burnt out panel is refused before
UNEVEN: Final = 0.3  # loss of a panel's light at its rim, as a share
HALF: Final = 0.5  # an edge is where the light is half-way between part and panel
INTERPOLATED: Final = 0.82  # noise between two pixels as a share of a pixel's, on the average
NOTHING_SEEN: Final = Contour(np.zeros((0, 2)), np.zeros((0, 2)))
PHASES: Final = np.linspace(0.0, 1.0, 101)  # positions of an edge between two pixels


@dataclass(frozen=True, eq=False, slots=True)
class Backlit:
    """A picture before the panel, relative to the panel's own light.

    Attributes
    ----------
    share : (height, width) 0 as dark as the part, 1 as bright as the panel there
    outline : of what is darker than half
    noise_px : standard deviation of one of its points, from the picture's noise and the edges'
        steepness
    judged : (height, width) the panel is in sight there, and neither gripper nor arm stands near
    width_px : standard deviation of the edges' blur
    """

    share: Float32Array
    outline: OutlineMeasure
    noise_px: float
    judged: BoolArray
    width_px: float


def backlit_outline(
    picture: Grey, scene: ViewScene, levels: tuple[float, float, float] | None = None
) -> Backlit:
    """Return the part's outline in a picture before the panel, and where it may be judged.

    A panel is darker at its rim and a lens towards its corners: one level for all would shift
    edges by a twentieth of a pixel.

    Parameters
    ----------
    picture : (height, width)
    scene : what stands in the view
    levels : its `threshold_levels` within the panel; None to find them
    """
    low, level, high = levels or threshold_levels(picture, scene.panel)
    height, width = picture.shape
    clear = scene.panel & ~grow(picture < level, BESIDE_PX)
    small = (width // REDUCED, height // REDUCED)
    reduced = cv2.resize(picture, small, interpolation=cv2.INTER_AREA)
    usable = cv2.resize(clear.astype(np.uint8), small, interpolation=cv2.INTER_AREA) > 0
    ground = fit_ground(
        np.asarray(reduced, np.uint8), usable, REDUCED, (width, height), SATURATED, UNEVEN
    )
    # where there is no part, or no panel, all is panel
    least = low + max(0.5 * (high - low), 1.0)
    panel = np.maximum(ground.over((0, 0, width, height)), least)
    share = ((picture.astype(np.float32) - low) / (panel - low)).astype(np.float32)
    judged = scene.panel & ~scene.holder_mask
    contour = subpixel_contour(share, HALF) if high > low else NOTHING_SEEN
    outline = OutlineMeasure(contour, judged)
    noise = pixel_noise(picture, clear, 1) / max(high - low, 1.0)
    slope = _steepness(share, outline)
    noise_px = float(np.hypot(INTERPOLATED * noise / slope, chord_px(slope)))
    return Backlit(share, outline, noise_px, judged, _blur_px(slope))


def chord_px(slope: float) -> float:
    """Return the rms error of the half level of a blurred edge that is taken for a line [px].

    Between two pixels an edge rises like an error function; its half level is looked for on their
    chord.

    Parameters
    ----------
    slope : of the edge there, share of its height a pixel, at its steepest
    """
    sigma = _blur_px(slope)
    before, after = ndtr(-PHASES / sigma), ndtr((1.0 - PHASES) / sigma)
    off = (HALF - before) / (after - before) - PHASES
    return float(np.sqrt(np.mean(off**2)))


def _blur_px(slope: float) -> float:
    return float(1.0 / (np.sqrt(2 * np.pi) * slope))


def _steepness(share: Float32Array, outline: OutlineMeasure) -> float:
    """Return the median slope of edges [1 / px], a sharp edge's where there are none."""
    if len(outline.points) == 0:
        return 1.0
    ahead, behind = (
        sample_picture(
            share,
            outline.points[:, :1] + side * outline.normals[:, :1],
            outline.points[:, 1:] + side * outline.normals[:, 1:],
        )
        for side in (0.5, -0.5)
    )
    return max(float(np.median(np.abs(ahead - behind))), 0.05)
