"""Picture values between pixels."""

from typing import Final

import cv2
import numpy as np
from cv2.typing import MatLike

from controller.arrays import Float32Array, FloatArray

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


def _sampled(picture: MatLike, u: Float32Array, v: Float32Array, border: int) -> Float32Array:
    return np.asarray(
        cv2.remap(picture, u, v, cv2.INTER_LINEAR, borderMode=border), dtype=np.float32
    )
