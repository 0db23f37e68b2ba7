"""Drawings for people, by casting several rays per pixel: shared by plan page and part sheet.

The picture of a calibrated camera is predicted in `controller.imaging.maps`; nothing is measured
here.
"""

import base64
from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import Float32Array, FloatArray, Int32Array
from controller.imaging import RayCaster

# Rows and columns, (n,) each.
Pixels = tuple[NDArray[np.int64], NDArray[np.int64]]

# Rays per pixel, each way.
FINER = 2


def cast(
    caster: RayCaster, origins_mm: FloatArray, directions: FloatArray, size: tuple[int, int]
) -> tuple[Int32Array, FloatArray]:
    """Return the triangle that each ray of a drawing meets, -1 for none, and the distance to it.

    Parameters
    ----------
    caster : caster of all that is drawn, in the frame of the rays
    origins_mm : (n, 3), or (1, 3) where all rays start at one point
    directions : (n, 3) row by row, or (1, 3) where all are parallel
    size : (width, height) rays

    Returns
    -------
    triangle : (height, width)
    distance_mm : (height, width) distance in units of the direction's length, inf without a hit
    """
    triangle, distance = caster.first_hit(origins_mm, directions)
    return triangle.reshape(size[::-1]), distance.reshape(size[::-1])


def jumps(triangle: Int32Array) -> Iterator[tuple[Pixels, Pixels]]:
    """Return neighbours that meet different triangles, (n,) each: along columns, then along rows.

    Parameters
    ----------
    triangle : (height, width), -1 where nothing is met
    """
    for axis in (0, 1):
        before, after = [slice(None)] * 2, [slice(None)] * 2
        before[axis], after[axis] = slice(None, -1), slice(1, None)
        row, column = np.nonzero(triangle[tuple(before)] != triangle[tuple(after)])
        yield (row, column), (row + (axis == 0), column + (axis == 1))


def smaller(image: Float32Array) -> Float32Array:
    """Return a drawing at the size it is shown, (height, width) or (height, width, 3)."""
    height, width = image.shape[:2]
    size = (width // FINER, height // FINER)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def png_bytes(image: NDArray[np.uint8], compression: int) -> bytes:
    """Return a picture, grey or blue first, as a file."""
    _, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, compression])
    return data.tobytes()


def as_uri(png: bytes) -> str:
    """Return a picture's file as a data URI."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def png_uri(image: NDArray[np.uint8], compression: int) -> str:
    """Return a picture, grey or blue first, as a data URI."""
    return as_uri(png_bytes(image, compression))
