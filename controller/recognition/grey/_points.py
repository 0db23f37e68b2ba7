"""Grey picture -> edge points: Sobel, a low threshold, and the ridge of the gradient.

The paper (references.md P3.2) thresholds low and keeps every point above. Here those off the ridge
are left out, so that a point is a place on the edge to a tenth of a pixel, and votes once.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from controller.arrays import Float32Array, FloatArray, Grey

from ._tolerances import GreyTolerances

ToPlane = Callable[[FloatArray], FloatArray]

SOBEL_OF_STEP = 2.1  # Sobel of a step of one level under blurs of 0.8 px of lens and here
RAYLEIGH_30 = 0.845  # 30 % of a Rayleigh distribution of deviation 1 are below
COARSEST = 4.0  # step between two levels of a digitiser of 6 bits
MAX_TIMES = 3  # more adds no detail
LEVEL_ROWS = 96  # rows that suffice to find the levels in use
PLAIN_SAMPLE = 1500  # edge points that show the strength of plain edges
ENLARGED = 2.0  # enlarged contours of a coarse digitiser are no softer
PLANE_NODES = 7  # nodes on a side of the grid that samples the map to the plane


@dataclass(frozen=True, eq=False, slots=True)
class EdgePoints:
    """Points on edges.

    Attributes
    ----------
    points_mm : (n, 2) in the plane
    normals : (n, 2) unit, towards the brighter side, in the plane
    strength : (n,) Sobel's magnitude, in grey levels times 8 per pixel
    pitch_mm : a mean pixel in the plane
    plain : strength of a plain edge of this picture
    """

    points_mm: FloatArray
    normals: FloatArray
    strength: FloatArray
    pitch_mm: float
    plain: float


def edge_points(grey: Grey, to_plane: ToPlane, tol: GreyTolerances) -> EdgePoints:
    """Return the edge points of a picture in the plane; references.md P3.2.

    Parameters
    ----------
    grey : (height, width) uint8
    to_plane : function from pixels (n, 2), x before y, to mm (n, 2) in the plane; called for a grid
        of points only, so it may be slow
    tol : thresholds of an edge

    Raises
    ------
    ValueError : not a grey picture of uint8
    """
    if grey.ndim != 2 or grey.dtype != np.uint8:
        raise ValueError(f"a grey picture of uint8 is needed, not {grey.dtype} of {grey.shape}")
    floor = _floor(grey, tol)
    times = _enlargement(grey.shape, to_plane, tol)
    if times > 1:
        small_to_plane, floor = to_plane, ENLARGED * floor / times
        large = cv2.resize(grey, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC)
        grey = np.asarray(large, np.uint8)

        def to_plane(pixels: FloatArray) -> FloatArray:
            return small_to_plane((pixels + 0.5) / times - 0.5)

    # ridges of noise on a soft slope are many and mean nothing; blur takes them, and not the edges
    soft = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), tol.blur_px)
    gx = cv2.Sobel(soft, cv2.CV_32F, 1, 0)
    gy = cv2.Sobel(soft, cv2.CV_32F, 0, 1)
    strength = np.asarray(cv2.magnitude(gx, gy), np.float32)
    threshold = max(_noise(strength) * tol.noise_factor, floor)
    height, width = grey.shape
    at = np.flatnonzero(strength > threshold)
    plain = threshold
    if len(at):
        own = strength.ravel()[at]
        plain = float(np.percentile(own[:: max(1, len(own) // PLAIN_SAMPLE)], 90))
        if tol.faint * plain > threshold:
            at = at[own > tol.faint * plain]
    at = at[np.searchsorted(at, width) : np.searchsorted(at, (height - 1) * width)]
    flat, fx, fy = strength.ravel(), gx.ravel()[at], gy.ravel()[at]
    step = np.where(np.abs(fx) >= np.abs(fy), 1, width)
    before32, here32, after32 = flat[at - step], flat[at], flat[at + step]
    v, u = np.divmod(at, width)
    on_ridge = (here32 >= before32) & (here32 > after32) & (u > 0) & (u < width - 1)
    chosen = np.flatnonzero(on_ridge)
    u, v, along_u = u[chosen], v[chosen], step[chosen] == 1
    before, here, after, fx, fy = (
        a[chosen].astype(np.float64) for a in (before32, here32, after32, fx, fy)
    )
    # the ridge between three samples of the axis that is nearer to the gradient
    offset = 0.5 * (before - after) / (before - 2 * here + after - 1e-9)
    pixels = np.column_stack([u + np.where(along_u, offset, 0), v + np.where(along_u, 0, offset)])
    points, du, dv, pitch = _on_plane(pixels, grey.shape, to_plane)
    # a gradient goes through a map as a row: times the inverse of its derivative (du dv)
    nx = fx * dv[:, 1] - fy * du[:, 1]
    ny = fy * du[:, 0] - fx * dv[:, 0]
    norm = np.hypot(nx, ny) * np.sign(du[:, 0] * dv[:, 1] - du[:, 1] * dv[:, 0])
    normals = np.stack([nx / norm, ny / norm], axis=1)
    return EdgePoints(points, normals, here, pitch, plain)


def _noise(strength: Float32Array) -> float:
    """Return the Sobel noise of plain surface, which covers at least a third of the picture."""
    sample = strength[1:-1:5, 1:-1:5]
    return float(np.percentile(sample, 30)) / RAYLEIGH_30 if sample.size else 0.0


def _floor(grey: Grey, tol: GreyTolerances) -> float:
    """Return the strength below which a step is the digitiser's own."""
    rows = grey[:: max(1, len(grey) // LEVEL_ROWS)]
    levels = np.flatnonzero(cv2.calcHist([rows], [0], None, [256], [0, 256]).ravel())
    step = min(float(np.diff(levels).min()), COARSEST) if len(levels) > 1 else 1.0
    # a step of two levels of a coarse digitiser is an edge already
    return min(tol.floor_levels * step, tol.floor_levels + 2 * (step - 1)) * SOBEL_OF_STEP


def _enlargement(shape: tuple[int, ...], to_plane: ToPlane, tol: GreyTolerances) -> int:
    """Return the factor by which a picture is enlarged to make cells smaller than features."""
    middle = np.array([shape[1] - 1, shape[0] - 1]) / 2
    at = np.asarray(to_plane(middle + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])))[:, :2]
    a, b = at[1] - at[0], at[2] - at[0]
    pitch = float(np.sqrt(abs(a[0] * b[1] - a[1] * b[0])))
    return int(np.clip(round(pitch / tol.fine_mm), 1, MAX_TIMES))


def _on_plane(
    pixels: FloatArray, shape: tuple[int, ...], to_plane: ToPlane
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return pixels in the plane, the map's derivatives (n, 2) there, and its mean pixel.

    The map is smooth: a bicubic through a grid holds it to a thousandth of a pixel, and a lens
    need not be undone for thousands of points.
    """
    height, width = shape
    half = np.maximum(np.array([(width - 1) / 2, (height - 1) / 2]), 1.0)
    target = np.asarray(to_plane(NODES * half + half), dtype=np.float64)[:, :2]
    factors = (FIT @ target).T  # (2, 10)
    powers = _powers(*(pixels.T / half[:, None] - 1.0))
    # of 1 x y xx xy yy xxx xxy xyy yyy, the derivatives are quadratic: of the first six
    by_u = factors[:, [1, 3, 4, 6, 7, 8]] * np.array([1, 2, 1, 3, 2, 1]) / half[0]
    by_v = factors[:, [2, 4, 5, 7, 8, 9]] * np.array([1, 1, 2, 1, 2, 3]) / half[1]
    (a, c), (b, d) = by_u[:, 0], by_v[:, 0]
    pitch = float(np.sqrt(abs(a * d - b * c)))
    quadratic = powers[:6]
    return (factors @ powers).T, (by_u @ quadratic).T, (by_v @ quadratic).T, pitch


def _powers(x: FloatArray, y: FloatArray) -> FloatArray:
    xx, xy, yy = x * x, x * y, y * y
    return np.stack([np.ones_like(x), x, y, xx, xy, yy, xx * x, xx * y, xy * y, yy * y])


def _nodes() -> tuple[FloatArray, FloatArray]:
    """Return the grid (n, 2) from -1 to 1, and the matrix from its values to a bicubic (10, n)."""
    grid = np.linspace(-1.0, 1.0, PLANE_NODES)
    nodes = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    return nodes, np.asarray(np.linalg.pinv(_powers(*nodes.T).T), np.float64)


NODES, FIT = _nodes()
