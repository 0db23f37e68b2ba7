"""Candidate views: configurations that hold the part up under every hypothesis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from controller.arrays import FloatArray
from controller.cad import Solid, sample_surface
from controller.imaging import inverse_pose

from ..geometry import Box
from ..model import CellLayout, HeldHypothesis, lit_count
from ..motion import Scene, segment_seconds
from ..views import candidate_directions, hold_up, reachable_views

DIRECTION_COUNT = 50
SPACING_MM = 6.0


def offered_views(
    hypotheses: Sequence[HeldHypothesis],
    layout: CellLayout,
    opening_mm: float,
    q_from: FloatArray,
    direction_count: int = DIRECTION_COUNT,
) -> tuple[FloatArray, FloatArray]:
    """Return configurations (k, 6) before the inspection camera, and their costs [s] (k,).

    One per direction, evenly spread about the first hypothesis: the nearest to `q_from` that the
    arm can reach free of contact with any of them in the arm gripper, with nothing standing before
    it if that can be had.

    Parameters
    ----------
    hypotheses : hypotheses of the part in the gripper, at least one
    layout : the cell
    opening_mm : distance between the inner sides of the fingers
    q_from : (6,) present joints of the arm
    direction_count : directions tried
    """
    first = hypotheses[0]
    vectors = candidate_directions(first.solid, direction_count).vectors
    samples = sample_surface(first.solid, SPACING_MM)
    scenes = [
        Scene(layout, opening_mm, layout.fixed_open_mm, _box_of(c.solid).placed(c.T_tcp_part))
        for c in hypotheses
    ]
    found = reachable_views(
        layout,
        scenes[0],
        samples,
        hold_up(first.solid, samples, layout, vectors),
        np.ones((len(vectors), len(samples.points_mm)), dtype=bool),
        inverse_pose(first.T_tcp_part),
        q_from,
    )
    if not found.q:
        return np.zeros((0, 6)), np.zeros(0)
    rows = np.concatenate([found.q[v] for v in sorted(found.q)])
    of_view = np.concatenate([np.full(len(found.q[v]), v) for v in sorted(found.q)])
    free = np.all([scene.free(rows) for scene in scenes[1:]] or [np.ones(len(rows), bool)], axis=0)
    rows, of_view = rows[free], of_view[free]
    _, nearest = np.unique(of_view, return_index=True)
    q = rows[nearest]
    return q, segment_seconds(layout, q_from, q) + layout.cell_times.look_s(
        lit_count(is_square=False)
    )


def _box_of(solid: Solid) -> Box:
    low, high = solid.mesh.bounds
    return Box.from_bounds(low[0], high[0], low[1], high[1], low[2], high[2])
