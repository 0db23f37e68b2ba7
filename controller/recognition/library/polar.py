"""A silhouette as a polar grid round its centroid, which a turn only shifts.

Rings are spaced in proportion to the silhouette, so that one grid serves bolts and plates. The
Fourier spectrum along the angle gives both the features that do not change with the turn (its
magnitudes, used by the index) and the turn itself (one correlation for all turns at once). Holes
count like outlines.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import Float32Array, FloatArray

RINGS = 32
ANGLES = 128
REACH = 3.2  # radius of the outermost ring, in radii of the disc of equal area
RASTER = 48.0  # pixels of the raster a silhouette is drawn on, to that radius
# harmonics of the turn that are kept: to 360 / 64 degrees and, between, by their phases
HARMONICS = 33
FEATURE_HARMONICS = 13
FEATURE_RINGS = 16
HALF = 127  # level from which a cell is covered


def polar_grid(loops: tuple[FloatArray, ...]) -> tuple[NDArray[np.uint8], FloatArray, float]:
    """Return the polar grid of a silhouette given by its loops, its centroid and its area.

    Parameters
    ----------
    loops : closed polygons (n, 2), outer ones and holes, in a plane with lengths

    Returns
    -------
    grid : (RINGS, ANGLES) uint8, 255 where it is covered; angles run from x towards y
    centroid : (2,)
    area : holes excluded

    Raises
    ------
    ValueError : it has no area
    """
    area, centroid = area_and_centroid(loops)
    if area <= 0:
        raise ValueError("a silhouette without area")
    scale = RASTER / np.sqrt(area / np.pi)
    half = int(REACH * RASTER)
    raster = np.zeros((2 * half, 2 * half), dtype=np.uint8)
    # 8 bits below the pixel; holes and overlaps cancel as they should
    drawn = [np.round(((loop - centroid) * scale + half) * 256).astype(np.int32) for loop in loops]
    cv2.fillPoly(raster, drawn, 255, cv2.LINE_8, 8)
    return from_raster(raster, np.array([half, half], dtype=np.float64), RASTER), centroid, area


def from_raster(
    raster: NDArray[np.uint8], centre_px: FloatArray, radius_px: float
) -> NDArray[np.uint8]:
    """Return the polar grid of a raster round a point.

    Parameters
    ----------
    raster : (h, w) 255 where the part is, 0 elsewhere
    centre_px : (2,) x before y
    radius_px : radius of a disc as large as the part: the grid's unit of length
    """
    r = (np.arange(RINGS) + 0.5) / RINGS * REACH * radius_px
    phi = np.arange(ANGLES) * 2 * np.pi / ANGLES
    x = centre_px[0] + r[:, None] * np.cos(phi)
    y = centre_px[1] + r[:, None] * np.sin(phi)
    smooth = cv2.GaussianBlur(raster, (0, 0), 0.03 * radius_px)
    return np.asarray(
        cv2.remap(smooth, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR)
    )


def area_and_centroid(loops: tuple[FloatArray, ...]) -> tuple[float, FloatArray]:
    """Return the area enclosed by loops, the largest of them outermost, and its centroid (2,).

    The sense of a loop does not matter: loops inside the largest one are holes.
    """
    origin = loops[0].mean(axis=0)
    areas, firsts = [], []
    for loop in loops:
        p = loop - origin
        q = np.roll(p, -1, axis=0)
        cross = p[:, 0] * q[:, 1] - q[:, 0] * p[:, 1]
        area = float(cross.sum()) / 2
        first = (cross[:, None] * (p + q)).sum(axis=0) / 6
        sign = -1.0 if area < 0 else 1.0
        areas.append(sign * area)
        firsts.append(sign * first)
    outer = int(np.argmax(areas))
    signs = np.full(len(areas), -1.0)
    signs[outer] = 1.0
    total = float(signs @ np.array(areas))
    if total <= 0:
        return 0.0, origin
    return total, origin + (signs @ np.array(firsts)) / total


def spectra(grids: NDArray[np.uint8]) -> NDArray[np.complex64]:
    """Return the spectra (..., RINGS, HARMONICS) of grids; overlap in them counts by area."""
    weight = np.sqrt((np.arange(RINGS) + 0.5) / RINGS).astype(np.float32)
    weighted = grids.astype(np.float32) * (weight[:, None] / 255.0)
    return np.asarray(
        np.fft.rfft(weighted, axis=-1)[..., :HARMONICS].astype(np.complex64), dtype=np.complex64
    )


def features(grids: NDArray[np.uint8]) -> Float32Array:
    """Return rotation-invariant features (n, f): magnitudes of the spectrum by ring."""
    magnitude = np.abs(spectra(grids))[..., :FEATURE_HARMONICS] / ANGLES
    magnitude[..., 1:] *= 2.0
    paired = magnitude.reshape(*magnitude.shape[:-2], FEATURE_RINGS, -1, FEATURE_HARMONICS)
    flat = paired.sum(axis=-2).reshape(*magnitude.shape[:-2], -1)
    return np.asarray(flat, dtype=np.float32)


def shape_of(grids: NDArray[np.uint8]) -> Float32Array:
    """Return `features`, (n, f), scaled to length 1: the shape alone, for any size."""
    rows = features(grids)
    size = np.linalg.norm(rows, axis=-1, keepdims=True)
    return np.asarray(rows / np.maximum(size, 1e-6), dtype=np.float32)


def turn_scores(model: NDArray[np.complex64], observed: NDArray[np.complex64]) -> Float32Array:
    """Return the overlap (cosine, 0..1) for each turn of models, (n, TURNS).

    Parameters
    ----------
    model : (n, RINGS, HARMONICS)
    observed : (RINGS, HARMONICS)

    Entry k is for turning the model by k * 360 / TURNS degrees from x towards y.
    """
    product = (np.conj(model) * observed).sum(axis=1)
    scores = np.fft.irfft(product, n=TURNS, axis=1) * TURNS / ANGLES
    norm = np.sqrt(_energy(model) * _energy(observed))
    return np.asarray(scores / np.maximum(norm, 1e-9)[:, None], dtype=np.float32)


def _energy(spectrum: NDArray[np.complex64]) -> FloatArray:
    squares = np.abs(spectrum) ** 2
    # harmonics above 0 stand for two
    both = 2 * squares.sum(axis=(-2, -1)) - squares[..., 0].sum(axis=-1)
    return np.asarray(both / ANGLES, dtype=np.float64)


TURNS = 360
