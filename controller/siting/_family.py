"""Siting's data of each part, independent of the poses of camera and fixed gripper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.cad import Solid, StablePose
from controller.imaging import inverse_pose
from controller.planning.grasps import (
    clear_of_table,
    resting_pose,
    select_arm_grasps,
    spread,
    turned_over,
)
from controller.planning.model import CellLayout, Grasp, PreparedPart
from controller.planning.motion import inverse_rows
from controller.planning.views import hidden_by_gripper, holding_boxes, view_poses

from .site import standoff_mm

PER_POSE_COUNT = 4  # grasps kept for picking the part up from each stable pose
PICK_TURN_COUNT = 6
PICK_LIFT_MM = 85.0
PICK_PATH_COUNT = 2  # branches of the arm per grasp and place
MAX_BRANCH_COUNT = 1000  # more branches than the kinematics has
# Two grasps complete each other if together they show this share of what all grasps show.
SHOWS_ALL = 0.99


@dataclass(frozen=True, slots=True, eq=False)
class Picks:
    """Picks of the part all over the table that the joints allow.

    Attributes
    ----------
    pose, place, grasp : (k,) pose, place and grasp of each pick: index of its stable pose, of its
        planar pose, of its grasp
    q_hold, q_above : (k, 6) configurations in which the arm gripper closes, and from which it comes
    """

    place_count: int
    pose: IntArray
    place: IntArray
    grasp: IntArray
    q_hold: FloatArray
    q_above: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class FamilyMember:
    """A part as siting sees it; grasp k + base_count is grasp k with the arm gripper turned over.

    Attributes
    ----------
    weights : (n,) share of the surface each sample stands for
    vectors : (v, 3) directions from the part to the camera
    shown : (base_count, v, n) mask of what the arm gripper leaves visible
    bits : the same packed eight samples to a byte
    T_view, inside : (v, r, 4, 4), (v, r) of `views.view_poses` in the cell as given
    start_poses : stable poses from which some grasp picks, wherever things stand
    from_pose : (p, 2 base_count) mask of the grasps that clear the table in each, from above
    probabilities : (p,) probabilities of these poses; their sum is 1
    completes : (base_count, base_count) the second grasp shows what the first one hides
    radius_mm : radius of the ball about the centre of mass that contains the part
    """

    prepared: PreparedPart
    weights: FloatArray
    vectors: FloatArray
    arm_grasps: tuple[Grasp, ...]
    fixed_grasps: tuple[Grasp, ...]
    shown: BoolArray
    bits: NDArray[np.uint8]
    T_view: FloatArray
    inside: BoolArray
    start_poses: tuple[StablePose, ...]
    from_pose: BoolArray
    probabilities: FloatArray
    completes: BoolArray
    picks: Picks
    radius_mm: float

    @property
    def name(self) -> str:
        """The part's name."""
        return self.prepared.solid.name

    @property
    def base_count(self) -> int:
        """The count of grasps without the turned-over ones."""
        return len(self.shown)

    @property
    def showable(self) -> float:
        """The share of the surface that some grasp shows in some direction."""
        return float(self.weights[self.shown.any(axis=(0, 1))].sum())

    def share(self, packed: NDArray[np.uint8]) -> FloatArray:
        """Return the share of the surface of packed samples (..., bytes)."""
        bits = np.unpackbits(packed, axis=-1, count=len(self.weights))
        return np.asarray(bits @ self.weights)


def family_member(
    part: PreparedPart, layout: CellLayout, grasp_count: int, fixed_count: int, direction_count: int
) -> FamilyMember:
    """Return a prepared part, thinned for a search over sites.

    Parameters
    ----------
    part : prepared in this cell
    layout : the cell
    grasp_count, fixed_count : grasps of the arm gripper and of the fixed one, besides the picks
    direction_count : count of directions; square views come first, as in the prepared part
    """
    solid = part.solid
    every = [g for g in part.arm_grasps if not g.id.endswith("'")]
    base = select_arm_grasps(
        solid, part.poses, every, layout.arm_gripper, PER_POSE_COUNT, grasp_count
    )
    fixed = [g for g in part.fixed_grasps if not g.id.endswith("'")]
    fixed = [fixed[k] for k in spread(fixed, range(len(fixed)), fixed_count)]
    some = _some_directions(part.directions.square_to, direction_count)
    vectors = part.directions.vectors[some]
    visible = part.visible[some]
    far = standoff_mm(layout)
    shown = np.stack(
        [
            visible
            & ~hidden_by_gripper(
                solid,
                part.samples,
                visible,
                vectors,
                far,
                g.T_part_tcp,
                holding_boxes(layout.arm_gripper, g),
            )
            for g in base
        ]
    )
    arm_grasps = (*base, *(turned_over(g) for g in base))
    T_view, inside = view_poses(solid, layout, vectors)
    poses = [p for p in part.poses if not p.rolling]
    from_pose = np.array(
        [clear_of_table(resting_pose(solid, p), arm_grasps, layout.arm_gripper) for p in poses],
        dtype=bool,
    ).reshape(len(poses), len(arm_grasps))
    able = np.flatnonzero(from_pose.any(axis=1))
    probabilities = np.array([p.probability for p in poses])[able]
    weights = part.weights
    return FamilyMember(
        prepared=part,
        weights=weights,
        vectors=vectors,
        arm_grasps=arm_grasps,
        fixed_grasps=(*fixed, *(turned_over(g) for g in fixed)),
        shown=shown,
        bits=np.packbits(shown, axis=2),
        T_view=T_view,
        inside=inside,
        start_poses=tuple(poses[k] for k in able.tolist()),
        from_pose=from_pose[able],
        probabilities=probabilities / probabilities.sum() if len(probabilities) else probabilities,
        completes=completing(np.asarray(shown.any(axis=1)), weights),
        picks=_picks(layout, solid, [poses[k] for k in able.tolist()], arm_grasps, from_pose[able]),
        radius_mm=float(np.linalg.norm(solid.hull_mm - solid.centroid_mm, axis=1).max()),
    )


def _picks(
    layout: CellLayout,
    solid: Solid,
    start_poses: Sequence[StablePose],
    grasps: Sequence[Grasp],
    from_pose: BoolArray,
) -> Picks:
    """Return the picks at the middle and the corners of the area where parts may lie."""
    (x0, x1), (y0, y1) = layout.set_down_mm
    places = [((x0 + x1) / 2, (y0 + y1) / 2), (x0, y0), (x0, y1), (x1, y0), (x1, y1)]
    turns = 2 * np.pi * np.arange(PICK_TURN_COUNT) / PICK_TURN_COUNT
    rows: list[tuple[IntArray, IntArray, IntArray]] = []
    joints: list[tuple[FloatArray, FloatArray]] = []
    for p, pose in enumerate(start_poses):
        T_rest = np.stack([resting_pose(solid, pose, x, y, t) for x, y in places for t in turns])
        for k in np.flatnonzero(from_pose[p]).tolist():
            T_hold = T_rest @ grasps[k].T_part_tcp
            T_above = T_hold.copy()
            T_above[:, :3, 3] -= PICK_LIFT_MM * T_hold[:, :3, 0]
            holds, branch, q_hold = inverse_rows(layout, T_hold)
            comes, other, q_above = inverse_rows(layout, T_above)
            # the path down keeps its branch, so pair configurations of the same branch
            mine, its = holds * MAX_BRANCH_COUNT + branch, comes * MAX_BRANCH_COUNT + other
            both = np.intersect1d(mine, its)
            i, j = np.searchsorted(mine, both), np.searchsorted(its, both)
            place = holds[i]
            kept = np.arange(len(place)) - np.searchsorted(place, place) < PICK_PATH_COUNT
            i, j = i[kept], j[kept]
            rows.append((np.full(len(i), p), holds[i], np.full(len(i), k)))
            joints.append((q_hold[i], q_above[j]))
    none = (np.zeros(0, dtype=np.int64),) * 3
    pose_of, place_of, grasp_of = (np.concatenate([r[c] for r in [none, *rows]]) for c in range(3))
    q = [np.concatenate([np.zeros((0, 6)), *[j[c] for j in joints]]) for c in range(2)]
    return Picks(len(places) * len(turns), pose_of, place_of, grasp_of, q[0], q[1])


def completing(shown_by_grasp: BoolArray, weights: FloatArray) -> BoolArray:
    """Return a mask (g, g): the second grasp of the pair shows the surface hidden by the first.

    Parameters
    ----------
    shown_by_grasp : (g, n) samples each grasp shows from some side
    weights : (n,) each sample's share of the surface
    """
    total = float(weights[shown_by_grasp.any(axis=0)].sum())
    both = shown_by_grasp[:, None] | shown_by_grasp[None]
    return np.asarray((both @ weights >= SHOWS_ALL * total) & ~np.eye(len(both), dtype=bool))


def _some_directions(square_to: IntArray, count: int) -> IntArray:
    """Return up to `count` directions: square ones first, then an even choice of the sphere's."""
    square = np.flatnonzero(square_to >= 0)[:count]
    sphere = np.flatnonzero(square_to < 0)
    left = min(count - len(square), len(sphere))
    if left <= 0:
        return square
    pick = np.floor(np.arange(left) * len(sphere) / left).astype(int)
    return np.sort(np.concatenate([square, sphere[pick]]))


def tcp_offsets_mm(members: Sequence[FamilyMember]) -> FloatArray:
    """Return the centre of mass in the arm gripper's frame for all members' grasps (k, 3)."""
    found = [
        inverse_pose(g.T_part_tcp)[:3, :3] @ m.prepared.solid.centroid_mm
        + inverse_pose(g.T_part_tcp)[:3, 3]
        for m in members
        for g in m.arm_grasps[: m.base_count]
    ]
    return np.stack(found)
