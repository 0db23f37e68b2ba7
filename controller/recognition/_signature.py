"""Coarse match of silhouettes: area first, then the turn at which two of them overlap best.

A silhouette round its centroid is sampled on a polar grid; turning it is shifting the grid, so
that one Fourier transform scores all turns at once. Holes count like outlines.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ANGLES = 360
RADII = 64


@dataclass(frozen=True, eq=False, slots=True)
class Signature:
    """A silhouette on a polar grid.

    Attributes
    ----------
    area_mm2 : its area, holes excluded
    spectrum : Fourier transform of the weighted grid along the angle
    norm : so that two equal silhouettes correlate to 1
    centroid_px : (2,) in the picture it was taken from
    """

    area_mm2: float
    spectrum: NDArray[np.complex128]
    norm: float
    centroid_px: Array


def signature(mask: Mask, mm_per_px: float, radius_mm: float) -> Signature:
    """Return the signature of a mask, sampled out to ``radius_mm`` round its centroid."""
    moments = cv2.moments(mask.astype(np.uint8), binaryImage=True)
    area = moments["m00"]
    centre = np.array([moments["m10"] / area, moments["m01"] / area])
    phi = np.arange(ANGLES) * 2 * np.pi / ANGLES
    r = (np.arange(RADII) + 0.5) / RADII * radius_mm / mm_per_px
    # image y points down: the angle runs as seen on the picture, mathematically negative
    x = centre[0] + r[:, None] * np.cos(phi)
    y = centre[1] - r[:, None] * np.sin(phi)
    grid = cv2.remap(
        mask.astype(np.float32), x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR
    ).astype(np.float64)
    weighted = grid * np.sqrt(r)[:, None]
    return Signature(
        area_mm2=float(area) * mm_per_px**2,
        spectrum=np.fft.fft(weighted, axis=1),
        norm=float(np.sqrt((weighted**2).sum())),
        centroid_px=centre,
    )


def turn_scores(model: Signature, observed: Signature) -> Array:
    """Return the overlap (cosine, 0..1) for turning the model by each whole degree, (360,)."""
    product = (np.conj(model.spectrum) * observed.spectrum).sum(axis=0)
    scores: Array = np.fft.ifft(product).real / max(model.norm * observed.norm, 1e-9)
    return scores


def best_turns(scores: Array, within: float, apart_deg: int, most: int) -> list[int]:
    """Return the turns [deg] whose score is close to the best, peaks only, best first."""
    order = np.argsort(-scores)
    chosen: list[int] = []
    for index in order:
        if scores[index] < scores[order[0]] - within or len(chosen) >= most:
            break
        gaps = [abs((int(index) - c + 180) % 360 - 180) for c in chosen]
        if all(gap >= apart_deg for gap in gaps):
            chosen.append(int(index))
    return chosen
