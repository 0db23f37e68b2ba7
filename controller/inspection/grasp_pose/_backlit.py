"""Outline in a picture before the backlight panel, and the uncertainty of its points."""

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
from ..limits import PANEL_HALF

# Reduction of the picture for the panel's own light, which changes slowly.
REDUCED: Final = 4
BESIDE_PX: Final = 8  # margin beside a part in which blur and light disturb the panel's level
# Level that no pixel exceeds; pictures with a burnt-out panel are refused earlier.
SATURATED: Final = 256
UNEVEN: Final = 0.3  # largest loss of a panel's light at its rim, as a share
INTERPOLATED: Final = 0.82  # mean noise between two pixels, as a share of a pixel's noise
NOTHING_SEEN: Final = Contour(np.zeros((0, 2)), np.zeros((0, 2)))
PHASES: Final = np.linspace(0.0, 1.0, 101)  # positions of an edge between two pixels


@dataclass(frozen=True, eq=False, slots=True)
class Backlit:
    """A picture before the panel, normalised by the panel's own light.

    Attributes
    ----------
    share : (height, width) 0 for the level of the part, 1 for that of the panel there
    outline : outline of the area darker than half
    noise_px : standard deviation of one of its points, from the picture's noise and the slope of
        the edges
    judged : (height, width) mask of the visible panel, away from gripper and arm
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
    """Return the part's outline in a picture before the panel, and the area where it is valid.

    A panel is darker at its rim, and a lens towards its corners; a single level would shift edges
    by a twentieth of a pixel.

    Parameters
    ----------
    picture : (height, width)
    scene : scene of the view
    levels : its `threshold_levels` within the panel; None to compute them
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
    # Without a part, or without a panel, everything counts as panel.
    least = low + max(0.5 * (high - low), 1.0)
    panel = np.maximum(ground.over((0, 0, width, height)), least)
    share = ((picture.astype(np.float32) - low) / (panel - low)).astype(np.float32)
    judged = scene.panel & ~scene.holder_mask
    contour = subpixel_contour(share, PANEL_HALF) if high > low else NOTHING_SEEN
    outline = OutlineMeasure(contour, judged)
    noise = pixel_noise(picture, clear, 1) / max(high - low, 1.0)
    slope = _steepness(share, outline)
    noise_px = float(np.hypot(INTERPOLATED * noise / slope, chord_px(slope)))
    return Backlit(share, outline, noise_px, judged, _blur_px(slope))


def chord_px(slope: float) -> float:
    """Return the rms error of a blurred edge's half level by linear interpolation [px].

    Between two pixels an edge rises like an error function, but its half level is found on their
    chord.

    Parameters
    ----------
    slope : largest slope of the edge, as a share of its height per pixel
    """
    sigma = _blur_px(slope)
    before, after = ndtr(-PHASES / sigma), ndtr((1.0 - PHASES) / sigma)
    off = (PANEL_HALF - before) / (after - before) - PHASES
    return float(np.sqrt(np.mean(off**2)))


def _blur_px(slope: float) -> float:
    return float(1.0 / (np.sqrt(2 * np.pi) * slope))


def _steepness(share: Float32Array, outline: OutlineMeasure) -> float:
    """Return the median slope of edges [1 / px]; without edges, that of a sharp one."""
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
