"""Names of array types; each function states their shape, unit and frame.

Replacements for slow operations of NumPy, the same to the last bit: sums over an axis of two or
three, and medians of few values. And what many rooms do with grids of pixels.
"""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
Int32Array = NDArray[np.int32]
ByteArray = NDArray[np.uint8]
BoolArray = NDArray[np.bool_]
# Numbers of places in another array.
IndexArray = NDArray[np.intp]
# A picture, (height, width).
Grey = NDArray[np.uint8]
# A picture in colour, (height, width, 3).
Picture = NDArray[np.uint8]

Number = TypeVar("Number", bound=np.generic)


def inner(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the inner products (...) of vectors (..., k), k of two or three."""
    total = a[..., 0] * b[..., 0]
    for k in range(1, a.shape[-1]):
        total += a[..., k] * b[..., k]
    return total


def lengths(vectors: FloatArray) -> FloatArray:
    """Return the lengths (...) of vectors (..., k), k of two or three."""
    return np.sqrt(inner(vectors, vectors))


def square_to(direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two unit vectors (3,) that form a right-handed frame with a unit one."""
    least = np.zeros(3)
    least[np.argmin(np.abs(direction))] = 1.0
    e1 = np.cross(direction, least)
    e1 /= np.linalg.norm(e1)
    return e1, np.cross(direction, e1)


def median(values: FloatArray | Float32Array) -> float:
    """Return the median of values (n,), one at least; none is NaN."""
    half = len(values) // 2
    if len(values) % 2:
        return float(np.partition(values, half)[half])
    low, high = np.partition(values, (half - 1, half))[half - 1 : half + 1]
    return float((low + high) / 2)


def on_each_pixel(values: NDArray[Number], step_px: int, shape: tuple[int, ...]) -> NDArray[Number]:
    """Return values of every ``step_px``-th pixel on each pixel, (height, width).

    Parameters
    ----------
    values : each for the pixels from its own on, to the right and below
    step_px : distance of those pixels
    shape : (height, width)
    """
    height, width = shape
    return np.repeat(np.repeat(values, step_px, axis=0), step_px, axis=1)[:height, :width]
