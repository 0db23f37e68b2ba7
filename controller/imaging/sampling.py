"""Picture values between pixels."""

from typing import Final

import cv2
import numpy as np
from cv2.typing import MatLike

from controller.arrays import Float32Array, FloatArray

SLOPE_BLUR_PX: Final = 0.8  # blur before slopes are taken: that of a sharp lens, about
MAX_SIDE: Final = 32_766  # OpenCV's remap takes maps below 2**15 - 1 each way


def sample_picture(
    picture: MatLike,
    x: FloatArray | Float32Array,
    y: FloatArray | Float32Array,
    border: int = cv2.BORDER_CONSTANT,
) -> Float32Array:
    """Return the values of a picture at places between its pixels, linear between them.

    Parameters
    ----------
    picture : (height, width)
    x, y : (n, k) places [px], of any number
    border : values beyond the picture's edge, as OpenCV names the mode; black by default

    Returns
    -------
    values : (n, k)
    """
    u, v = np.asarray(x, np.float32), np.asarray(y, np.float32)
    if u.size == 0:
        return np.zeros(u.shape, np.float32)
    if max(u.shape) <= MAX_SIDE:
        return _sampled(picture, u, v, border)
    flat_u, flat_v = u.reshape(-1, 1), v.reshape(-1, 1)
    starts = range(0, len(flat_u), MAX_SIDE)
    pieces = [slice(start, start + MAX_SIDE) for start in starts]
    values = [_sampled(picture, flat_u[one], flat_v[one], border) for one in pieces]
    return np.concatenate(values).reshape(u.shape)


def slopes_of(picture: MatLike) -> tuple[Float32Array, Float32Array]:
    """Return the slopes (h, w) of a picture along x and along y, softened [grey / px]."""
    soft = cv2.GaussianBlur(np.asarray(picture, np.float32), (0, 0), SLOPE_BLUR_PX)
    dx = cv2.Sobel(soft, cv2.CV_32F, 1, 0, ksize=3) / 8
    dy = cv2.Sobel(soft, cv2.CV_32F, 0, 1, ksize=3) / 8
    return np.asarray(dx, np.float32), np.asarray(dy, np.float32)


def _sampled(picture: MatLike, u: Float32Array, v: Float32Array, border: int) -> Float32Array:
    return np.asarray(
        cv2.remap(picture, u, v, cv2.INTER_LINEAR, borderMode=border), dtype=np.float32
    )
