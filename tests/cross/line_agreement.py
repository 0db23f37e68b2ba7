"""How far two line drawings agree: shares of their length, as point sets, whatever is doubled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from occ_views import KINDS, STEP_MM
from scipy.spatial import cKDTree

from controller.cad.views import LineView

Array = NDArray[np.float64]
WITHIN_MM = 0.05


@dataclass(frozen=True, eq=False)
class Agreement:
    """Two drawings side by side.

    Lines where the surface goes on smoothly count as found by either side where they are drawn,
    but nobody has to draw the seam of one and the same surface.

    Attributes
    ----------
    found : share of the kernel's length, seams left out, that we draw within 0.05 mm
    right : share of our length that the kernel draws within 0.05 mm, seams included
    missing, extra : (n, 2) points of the rest
    extra_kind : (n,) what we take them for
    """

    ours_mm: float
    kernel_mm: float
    found: float
    right: float
    missing: Array
    extra: Array
    extra_kind: NDArray[np.str_]


def sample(points: Array) -> tuple[Array, Array]:
    """Return points along a polyline (p, 2) and the length each stands for (p,)."""
    sides = np.diff(points, axis=0)
    length = np.linalg.norm(sides, axis=1)
    count = np.maximum(np.ceil(length / STEP_MM).astype(int), 1)
    side = np.repeat(np.arange(len(count)), count)
    step = np.arange(len(side)) - np.repeat(np.cumsum(count) - count, count)
    share = (step + 0.5) / count[side]
    return points[side] + share[:, None] * sides[side], (length / count)[side]


def compare(view: LineView, drawn: dict[str, Array]) -> Agreement:
    """Lay our drawing over the kernel's."""
    runs = [sample(edge.points) for edge in view.edges]
    ours = np.concatenate([points for points, _ in runs])
    length = np.concatenate([lengths for _, lengths in runs])
    kind = np.concatenate(
        [np.full(len(run[0]), edge.kind) for run, edge in zip(runs, view.edges, strict=True)]
    )
    kernel, needed = drawn["points"], drawn["kind"] != KINDS.index("seam")
    is_right = cKDTree(kernel).query(ours)[0] <= WITHIN_MM
    is_found = cKDTree(ours).query(kernel)[0] <= WITHIN_MM
    weight = drawn["length_mm"]
    return Agreement(
        ours_mm=float(length.sum()),
        kernel_mm=float(weight[needed].sum()),
        found=float(weight[needed & is_found].sum() / weight[needed].sum()),
        right=float(length[is_right].sum() / length.sum()),
        missing=kernel[needed & ~is_found],
        extra=ours[~is_right],
        extra_kind=kind[~is_right],
    )
