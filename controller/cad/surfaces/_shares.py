"""Share of a surface that a set of samples represents, and its uncertainty."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import BoolArray, FloatArray, IndexArray

from ._samples import SurfaceSamples, by_face

NEIGHBOUR_COUNT = 6
# A spot of this many sample cells is missed with probability 5 %; a smaller one may have no point.
UNMET_CELLS = 3.0
KEPT_PARTS = 4  # parts whose neighbours are kept, for the next part of the kind


def share_of(samples: SurfaceSamples, chosen: BoolArray) -> float:
    """Return the share of the surface that chosen samples (m,) represent, 0..1."""
    areas = samples.areas_mm2
    return float(areas[chosen].sum() / areas.sum())


def uncertainty_of(samples: SurfaceSamples, chosen: BoolArray) -> float:
    """Return the expanded uncertainty (k = 2) of `share_of`, 0..1; see `face_shares`."""
    areas = samples.areas_mm2
    return float(_uncertain(samples, _variances_mm4(samples, chosen), areas >= 0.0))


def face_shares(
    samples: SurfaceSamples, chosen: BoolArray, face_count: int
) -> tuple[FloatArray, FloatArray]:
    """Return the share of each face (f,) that chosen samples represent, and its U (k = 2) (f,).

    A cell on the border of the chosen area, with neighbours on the other side, may belong to either
    side; spots smaller than a cell may have no sample in them.

    Parameters
    ----------
    samples : m of them, each for the surface nearest to it
    chosen : (m,) bool
    face_count : number of faces of the part
    """
    variances = _variances_mm4(samples, chosen)
    shares, uncertain = np.zeros(face_count), np.ones(face_count)
    for face in np.unique(samples.face_ids):
        mine = samples.face_ids == face
        shares[face] = share_of(samples.rows(np.flatnonzero(mine)), chosen[mine])
        uncertain[face] = _uncertain(samples, variances, mine)
    return shares, uncertain


def _variances_mm4(samples: SurfaceSamples, chosen: BoolArray) -> FloatArray:
    """Return the variance of area that each sample adds to the chosen ones (m,) [mm4]."""
    if len(chosen) < 2:
        return samples.areas_mm2**2
    around, others = _around(samples)
    share = (chosen[around] & others).sum(axis=1) / others.sum(axis=1)
    return np.asarray(samples.areas_mm2**2 * share * (1.0 - share))


@lru_cache(maxsize=KEPT_PARTS)
def _around(samples: SurfaceSamples) -> tuple[IndexArray, BoolArray]:
    """Return the samples around each one (m, k), itself first, and which are of its own face."""
    places = by_face(samples.points_mm, samples.face_ids)
    _, around = cKDTree(places).query(places, k=min(NEIGHBOUR_COUNT + 1, len(places)))
    is_same_face = samples.face_ids[around] == samples.face_ids[:, None]
    return np.asarray(around, np.intp), np.asarray(is_same_face)


def _uncertain(samples: SurfaceSamples, variances_mm4: FloatArray, mine: BoolArray) -> float:
    """Return the expanded uncertainty of a share of the surface of some samples (m,) bool."""
    areas = samples.areas_mm2[mine]
    whole = float(areas.sum())
    if whole <= 0.0:
        return 1.0
    unmet_mm2 = UNMET_CELLS * float((areas**2).sum()) / whole
    return min(1.0, (2.0 * float(np.sqrt(variances_mm4[mine].sum())) + unmet_mm2) / whole)
