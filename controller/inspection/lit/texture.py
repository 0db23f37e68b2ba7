"""Texture of a lit picture: residuals about smooth faces, including local defects.

The brightness of a face as a whole, and its slow change across the face, depend on finish and lamp;
both are taken from the picture itself, guided by the prediction. The residual is the contrast of
the face, as a share of its brightness: texture of the finish, camera noise and local marks. Near
edges and borders of shadows predicted from the CAD model, nothing is compared.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray, Int32Array, inner, median

from .surface import Surface

Window = tuple[slice, slice]

# Least cosine between neighbouring nodes' normals on a smooth face.
CREASE_COSINE: Final = float(np.cos(np.radians(8.0)))
DEPTH_STEP: Final = 4.0  # largest step between nodes, in that of a plane seen as flat as allowed
MIN_REGION: Final = 60  # least number of nodes for the course of a face's brightness
FITTED_COUNT: Final = 3000  # largest number of a face's nodes in the fit
FIT_ROUNDS: Final = 4
OUTLYING: Final = 2.5  # robust standard deviations from which a node loses weight
SLOW_NODES: Final = 14.0  # length above which changes are due to finish or light
DARKEST_GREY: Final = 6.0  # level below which contrast is relative to this level
# Ratio of the spreads of a ruled face's normals, along its lines and across them.
RULED: Final = 0.05
UNEVEN: Final = 0.02  # range of normals, or of neighbours' light, that shapes a face's brightness
RULED_COUNT: Final = 40  # number of nodes per bin of normals


@dataclass(frozen=True, eq=False, slots=True)
class Texture:
    """Contrast of a picture's faces about their own smooth brightness; (h, w) each.

    Attributes
    ----------
    region : connected piece of a face, from 1; 0 where nothing is compared
    contrast : share of the brightness; 0 outside regions
    smooth : the brightness itself [grey]
    shape : contrast that the fitted brightness has by itself, as at a highlight's border: what of
        it is wrong is left in `contrast`
    shaped : (count + 1,) by region: its normals vary, or the light that its neighbours throw
    """

    region: Int32Array
    contrast: Float32Array
    smooth: Float32Array
    shape: Float32Array
    shaped: BoolArray


def creases(surface: Surface) -> BoolArray:
    """Return a mask (h, w) of nodes beside which a face of the CAD model turns sharply."""
    seen = surface.seen
    normal = np.zeros((*seen.shape, 3), dtype=np.float32)
    normal[seen] = surface.normals
    return _beside(
        lambda a, b: seen[a] & seen[b] & (inner(normal[a], normal[b]) < CREASE_COSINE), seen.shape
    )


def borders(face: Int32Array, depth_mm: FloatArray, side_mm: FloatArray) -> BoolArray:
    """Return a mask (h, w) of places beside which another face begins, or one stands before it.

    Parameters
    ----------
    face : (h, w) met, -1 where none
    depth_mm : (h, w) along the camera's axis
    side_mm : (h, w) side of a place, square to the line of sight
    """

    def other(a: Window, b: Window) -> BoolArray:
        far = np.abs(depth_mm[a] - depth_mm[b]) > DEPTH_STEP * np.maximum(side_mm[a], side_mm[b])
        return np.asarray((face[a] != face[b]) | ((face[a] >= 0) & far))

    return _beside(other, face.shape)


def _beside(differ: Callable[[Window, Window], BoolArray], shape: tuple[int, int]) -> BoolArray:
    """Return a mask (h, w) of places that differ from the next one in a row or column."""
    out = np.zeros(shape, dtype=bool)
    whole, but_last, but_first = slice(None), slice(None, -1), slice(1, None)
    for a, b in (((but_last, whole), (but_first, whole)), ((whole, but_last), (whole, but_first))):
        other = differ(a, b)
        out[a] |= other
        out[b] |= other
    return out


def learned_texture(contrast: Float32Array, smooth: Float32Array, mask: BoolArray) -> Texture:
    """Return the texture of a picture against good parts.

    Their appearance is known across borders of shadows and faces, so everything is one region.

    Parameters
    ----------
    contrast, smooth : (h, w) of the picture against good parts, and their brightness [grey]
    mask : (h, w) where they are known
    """
    return Texture(
        mask.astype(np.int32),
        np.where(mask, contrast, np.float32(0)),
        np.where(mask, smooth, np.float32(1)),
        np.zeros(mask.shape, dtype=np.float32),
        np.zeros(2, dtype=bool),
    )


def find_texture(
    observed: Float32Array,
    surface: Surface,
    usable: BoolArray,
    predicted: Float32Array,
    thrown: Float32Array,
) -> Texture:
    """Return the texture of a picture's faces.

    Parameters
    ----------
    observed : (h, w) grey
    surface : surface seen by its nodes
    usable : (h, w) on smooth faces, off edges and borders of shadows, so that pieces of two faces
        do not touch
    predicted : (h, w) grey, to any factor face by face
    thrown : (h, w) light from neighbours as a share of the lamp's own, to any factor
    """
    count, label, stats, _ = cv2.connectedComponentsWithStats(
        usable.astype(np.uint8), connectivity=4
    )
    too_small = stats[:, cv2.CC_STAT_AREA] < MIN_REGION
    too_small[0] = True
    label[too_small[label]] = 0
    smooth = np.ones(observed.shape, dtype=np.float32)
    shaped = np.zeros(count, dtype=bool)
    normal = np.zeros((*observed.shape, 3), dtype=np.float32)
    normal[surface.seen] = surface.normals
    for i in np.flatnonzero(~too_small).tolist():
        x, y, w, h = stats[i, :4]
        window = (slice(y, y + h), slice(x, x + w))
        here = label[window] == i
        normals = normal[window][here]
        is_curved = float(np.ptp(normals, axis=0).max()) > UNEVEN
        shaped[i] = is_curved or float(np.ptp(thrown[window][here])) > UNEVEN
        fitted = _smooth(
            observed[window], predicted[window], thrown[window], here, normals, is_curved
        )
        smooth[window][here] = fitted
    inside = label > 0
    contrast = np.where(inside, (observed - smooth) / np.maximum(smooth, DARKEST_GREY), 0.0)
    weight = inside.astype(np.float32)
    contrast = _high_pass(np.asarray(contrast, np.float32), weight)
    shape = np.zeros_like(contrast)
    bent = shaped[label]
    if bent.any():
        mean = _slow(np.where(bent, smooth, 0).astype(np.float32), bent.astype(np.float32))
        shape = np.where(bent, smooth / np.maximum(mean, 1.0) - 1.0, 0.0).astype(np.float32)
    return Texture(label.astype(np.int32), contrast, smooth, shape, shaped)


def _smooth(
    observed: Float32Array,
    predicted: Float32Array,
    thrown: Float32Array,
    here: BoolArray,
    normals: Float32Array,
    is_curved: bool,
) -> FloatArray:
    """Return a region's brightness (n,), smoothed by the prediction and a slow change of it."""
    rows, columns = np.nonzero(here)
    values = observed[here].astype(np.float64)
    size = max(here.shape)
    x = 2 * columns / size - here.shape[1] / size
    y = 2 * rows / size - here.shape[0] / size
    guide = predicted[here].astype(np.float64)
    guide /= max(float(guide.mean()), 1e-3)
    slow = [np.ones_like(x), x, y, x * x, x * y, y * y]
    guided = [guide, guide * x, guide * y] if is_curved else [guide]
    guided.append(guide * thrown[here])
    design = np.stack([*guided, *slow], axis=1)
    chosen = slice(None, None, max(1, len(values) // FITTED_COUNT))
    terms, b = design[chosen], values[chosen]
    weight = np.ones(len(b))
    ridge = 1e-6 * len(b) * np.eye(terms.shape[1])
    solution = np.zeros(terms.shape[1])
    for _ in range(FIT_ROUNDS):
        weighed = terms * weight[:, None]
        solution = np.linalg.solve(weighed.T @ terms + ridge, weighed.T @ b)
        off = np.abs(b - terms @ solution)
        scale = 1.4826 * median(off) + 0.1
        weight = np.minimum(1.0, OUTLYING * scale / np.maximum(off, 1e-9)) ** 2
    fitted = design @ solution
    if is_curved:
        fitted = fitted + _ruled(values - fitted, normals)
    return np.maximum(fitted, 1.0)


def _ruled(rest: FloatArray, normals: Float32Array) -> FloatArray:
    """Return the values common to each straight line of a face bent one way (n,), else zeros.

    Along a cylinder's straight lines the normal is constant, and so is the effect of the lamp.
    """
    centred = normals - normals.mean(axis=0)
    values, directions = np.linalg.eigh(centred.T @ centred)
    if len(rest) < 4 * RULED_COUNT or values[1] > RULED * values[2]:
        return np.zeros_like(rest)
    along = centred @ directions[:, 2]
    order = np.argsort(along, kind="stable")
    bins = max(4, len(rest) // RULED_COUNT)
    parts = np.array_split(order, bins)
    middle = np.array([float(along[p].mean()) for p in parts])
    typical = np.array([median(rest[p]) for p in parts])
    return np.asarray(np.interp(along, middle, typical))


def _slow(values: Float32Array, weight: Float32Array) -> Float32Array:
    """Return a weighted moving mean of values (h, w), with weights 0 or 1."""
    top = cv2.GaussianBlur(values * weight, (0, 0), SLOW_NODES)
    bottom = cv2.GaussianBlur(weight, (0, 0), SLOW_NODES)
    return np.asarray(top / np.maximum(bottom, 1e-3), np.float32)


def _high_pass(contrast: Float32Array, weight: Float32Array) -> Float32Array:
    """Return a contrast (h, w) without its slow changes, which outliers do not affect."""
    some = contrast[weight > 0]
    if not len(some):
        return contrast
    limit = 3 * 1.4826 * median(np.abs(some)) + 1e-3
    out = contrast - _slow(np.clip(contrast, -limit, limit), weight)
    return np.asarray(out * weight, np.float32)
