"""The sensor behind the lens: blur, exposure, gain, shot and read noise, saturation, digits."""

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..layout import BLUR_SIGMA_PX
from .geometry import Array32

NOMINAL_EXPOSURE_S: Final = 0.010
GREY_AT_UNIT: Final = 210.0  # grey above black of radiance 1 at nominal exposure and gain 1
BLACK_GREY: Final = 4.0
_KERNEL_SIGMAS: Final = 3.0  # extent of the blur's kernel
ELECTRONS_PER_GREY: Final = 60.0  # at gain 1: 15 300 electrons fill 255 grey
READ_NOISE_ELECTRONS: Final = 12.0


@dataclass(frozen=True, slots=True)
class Exposure:
    """The settings of an exposure.

    Attributes
    ----------
    exposure_s : exposure time
    gain : gain of the amplifier behind it, 1 is none
    seed : seed of the noise
    bits : 8, or 16 (then full scale is 65535)
    """

    exposure_s: float
    gain: float = 1.0
    seed: int = 0
    bits: int = 8


def blurred(radiance: Array32, sigma_px: float = BLUR_SIGMA_PX) -> Array32:
    """Return a sharp picture blurred by the lens.

    Parameters
    ----------
    radiance : (h, w) light on each pixel
    sigma_px : standard deviation of the blur
    """
    side_px = 2 * math.ceil(_KERNEL_SIGMAS * sigma_px) + 1
    soft = cv2.GaussianBlur(radiance, (side_px, side_px), sigma_px, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(soft, np.float32)


def develop(
    radiance: Array32, exposure: Exposure, *, noisy: bool = True
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Return the digits of a blurred picture, (h, w).

    Parameters
    ----------
    radiance : (height, width) light on each pixel, 1 as from the middle of a backlight panel at
        level 1
    exposure : its time, gain, depth in bits, and the seed of its noise
    noisy : add shot and read noise
    """
    scale = GREY_AT_UNIT * exposure.exposure_s / NOMINAL_EXPOSURE_S
    electrons = radiance * np.float32(scale * ELECTRONS_PER_GREY)
    if noisy:
        rng = np.random.Generator(np.random.SFC64(exposure.seed))
        noise = rng.standard_normal(electrons.shape, dtype=np.float32)
        # shot noise and read noise are independent: one draw for both
        noise *= np.sqrt(electrons + np.float32(READ_NOISE_ELECTRONS**2))
        electrons += noise
    grey = electrons
    grey *= np.float32(exposure.gain / ELECTRONS_PER_GREY)
    grey += np.float32(BLACK_GREY + 0.5)
    if exposure.bits == 8:
        np.clip(grey, 0.0, 255.0, out=grey)
        digits: NDArray[np.uint8] = grey.astype(np.uint8)
        return digits
    grey = (grey - np.float32(0.5)) * np.float32(257.0)
    deep: NDArray[np.uint16] = np.clip(grey + np.float32(0.5), 0.0, 65535.0).astype(np.uint16)
    return deep
