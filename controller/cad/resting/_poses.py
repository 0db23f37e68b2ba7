"""How a solid can lie: hull facets over which its centre of mass stands (paper, section 2.1).

The odds are the quasi-static ones of Goldberg et al. as computed by trimesh; the tip energy is
what the paper ranks by. Poses that tip at less than `ROLLING_TIP_MM` of lift are strips of a
tessellated curve: the part rolls there and does not rest (planning.md 4).
"""

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from ..solid import Solid

Array = NDArray[np.float64]

GRAVITY_M_S2 = 9.81
ROLLING_TIP_MM = (
    0.15  # a strip of a tessellated curve lifts by 0.1 mm, the flattest real rest by more
)


@dataclass(frozen=True, eq=False, slots=True)
class StablePose:
    """A way the part can lie.

    Attributes
    ----------
    index : rank, likeliest first
    R : (3, 3) rotation CAD -> upright, z up
    probability : of a part dropped at random
    tip_energy_mj_per_kg : work to tip it over its easiest edge
    com_height_mm : height of the centre of mass above the table
    rolling : True where it rests on a strip of a curve and would roll on
    """

    index: int
    R: Array
    probability: float
    tip_energy_mj_per_kg: float
    com_height_mm: float
    rolling: bool


def stable_poses(solid: Solid, min_probability: float = 0.002) -> tuple[StablePose, ...]:
    """Return the ways a solid can lie, likeliest first."""
    transforms, odds = trimesh.poses.compute_stable_poses(
        solid.mesh, center_mass=solid.centroid_mm, sigma=0.0, n_samples=1, threshold=0.0
    )
    found = []
    hull = np.asarray(solid.mesh.convex_hull.vertices) - solid.centroid_mm
    for T, probability in sorted(zip(transforms, odds, strict=True), key=lambda pair: -pair[1]):
        if probability < min_probability:
            continue
        R = np.asarray(T[:3, :3], dtype=np.float64)
        upright = hull @ R.T
        height = -float(upright[:, 2].min())
        lift = _tip_lift_mm(upright, height)
        found.append((R, float(probability), lift, height))
    return tuple(
        StablePose(i, R, p, GRAVITY_M_S2 * lift, height, lift < ROLLING_TIP_MM)
        for i, (R, p, lift, height) in enumerate(found)
    )


def _tip_lift_mm(upright: Array, height: float) -> float:
    """Return how far the centre of mass rises when tipping over the nearest support edge."""
    support = upright[upright[:, 2] < -height + 0.05, :2]
    if len(support) < 3:
        return 0.0
    try:
        hull = ConvexHull(support, qhull_options="QJ")
    except ValueError:
        return 0.0
    distance = float((-hull.equations[:, 2]).min())  # of the origin, where the centre stands
    return float(np.hypot(height, distance) - height) if distance > 0 else 0.0
