"""Configurations in which a grasp can show a direction, and the surface then in sight."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.cad import SurfaceSamples

from ..geometry import Box
from ..model import CellLayout
from ..motion import Scene, inverse_rows, link_boxes
from ._arm import hidden_by_boxes, may_cover, standing_between
from ._poses import Showing

KEPT_Q = 4  # configurations kept per view and grasp
# Configurations checked first; nearly all within the joint limits are free (planning-facts.md 1.3).
FIRST_TRIED_COUNT = 4
# The same number where the arm stands in the view: only a check shows which configuration hides
# least.
FIRST_TRIED_BETWEEN_COUNT = 12


@dataclass(frozen=True, slots=True, eq=False)
class GraspViews:
    """Views that one grasp can show.

    Attributes
    ----------
    q : direction -> (k, 6) configurations free of contact, the handiest first
    shown : (v, n) samples in sight in every one of them; of directions without any
        configuration, what the arm gripper would leave in sight
    """

    q: Mapping[int, FloatArray]
    shown: BoolArray


def reachable_views(
    layout: CellLayout,
    scene: Scene,
    samples: SurfaceSamples,
    showing: Showing,
    left_by_gripper: BoolArray,
    T_part_tcp: FloatArray,
    q_liked: FloatArray,
) -> GraspViews:
    """Return one grasp's configurations for each direction, and the samples that they show.

    Configurations in which neither the arm nor a post stands before the part come first, those
    near `q_liked` (6,) first among them. Where there are none, those stay in which the arm hides
    least.

    Parameters
    ----------
    layout : the cell, with inspection camera and station
    scene : the arm with the part in this grasp
    samples : n, of the part's surface
    showing : of `hold_up`, for v directions
    left_by_gripper : (v, n) samples the arm gripper leaves in sight; directions without any are not
        tried
    T_part_tcp : (4, 4) T_part_tcp of the grasp
    q_liked : (6,) row of joints
    """
    shown = left_by_gripper.copy()
    allowed = showing.inside & np.asarray(left_by_gripper.any(axis=1))[:, None]
    for v, inside in showing.partly.items():
        allowed[v] = (inside & left_by_gripper[v]).any(axis=1)
    view, roll = np.nonzero(allowed)
    if len(view) == 0:
        return GraspViews({}, shown)
    index, _, q = inverse_rows(layout, showing.T_world_part[view, roll] @ T_part_tcp)
    if len(index) == 0:
        return GraspViews({}, shown)
    v_of, r_of = view[index], roll[index]
    fixed = standing_between(layout, scene.statics(), showing.cone)
    T_links, half_links = link_boxes(layout, q)
    links = showing.cone.meets(T_links.reshape(-1, 4, 4), half_links.reshape(-1, 3))
    links = links.reshape(T_links.shape[:2])
    row, link = np.nonzero(links)
    links[row, link] = may_cover(
        layout, T_links[row, link], half_links[row, link], showing.extent[v_of[row], r_of[row]]
    )
    between: BoolArray = np.asarray(links.any(axis=1))
    away_s = (np.abs(q - q_liked) / layout.arm.timing.joint_speeds).max(axis=1)
    order = np.lexsort((away_s, between, v_of))
    rows = _free_rows(scene, q, v_of, between, order)
    found: dict[int, FloatArray] = {}
    for v, members in rows.items():
        whole = v not in showing.partly
        clear = members[~between[members]]
        if whole and not fixed and len(clear):
            found[v] = q[clear[:KEPT_Q]]
            continue
        hidden = np.zeros((len(members), shown.shape[1]), dtype=bool)
        for k, row in enumerate(members):
            boxes = list(fixed)
            if between[row]:
                boxes += [
                    Box(T_links[row, i], half_links[row, i]) for i in np.flatnonzero(links[row])
                ]
            T = showing.T_world_part[v, r_of[row]]
            if boxes:
                hidden[k] = hidden_by_boxes(layout, boxes, T, samples.points_mm, left_by_gripper[v])
            if not whole:
                hidden[k] |= left_by_gripper[v] & ~showing.partly[v][r_of[row]]
        best = int(np.argmin(hidden @ samples.areas_mm2))
        left = left_by_gripper[v] & ~hidden[best]
        if left.any():
            alike = ~(hidden & left).any(axis=1)
            found[v] = q[members[alike][:KEPT_Q]]
            shown[v] = left
    return GraspViews(found, shown)


def _free_rows(
    scene: Scene, q: FloatArray, v_of: IntArray, between: BoolArray, order: IntArray
) -> dict[int, IntArray]:
    """Return the contact-free rows of each direction, in order; few are checked if few suffice.

    Parameters
    ----------
    q : (m, 6)
    v_of : (m,) direction of each
    between : (m,) the arm may stand before the part
    order : (m,) rows by direction, the best ones first
    """
    of_view = v_of[order]
    place = np.arange(len(order)) - np.searchsorted(of_view, of_view)
    free = np.zeros(len(order), dtype=bool)
    tried = np.where(between[order], FIRST_TRIED_BETWEEN_COUNT, FIRST_TRIED_COUNT)
    (first,) = np.nonzero(place < tried)
    free[first] = scene.free(q[order[first]])
    done = np.zeros(int(of_view.max()) + 1, dtype=bool)
    done[of_view[free]] = True
    (rest,) = np.nonzero((place >= tried) & ~done[of_view])
    if len(rest):
        free[rest] = scene.free(q[order[rest]])
    rows: dict[int, list[int]] = {}
    for k in np.flatnonzero(free):
        rows.setdefault(int(of_view[k]), []).append(int(order[k]))
    return {v: np.array(members) for v, members in rows.items()}
