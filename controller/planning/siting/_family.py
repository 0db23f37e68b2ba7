"""What siting needs of each part, none of which depends on where camera and fixture stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.cad import StablePose, inverse_pose

from ..boxes import BoolArray
from ..grip import Grip
from ..grips import clear_of_table, resting_pose, select_arm_grips, spread, turned_over
from ..layout import CellLayout, FloatArray, IntArray
from ..prepared import PreparedPart
from ..views import hidden_by_hand, holding_boxes, view_poses
from ._site import standoff_mm

PER_POSE_N = 4  # grips kept for taking each stable pose up
SHOWS_ALL = 0.99  # of what a pair of grips could show together: then they complement each other


@dataclass(frozen=True, slots=True, eq=False)
class FamilyMember:
    """One part as siting sees it; grips k and k + base_n are the same, the hand turned over.

    Attributes
    ----------
    weights : (n,) share of the surface each sample stands for
    vectors : (v, 3) directions from the part to the camera
    shown : (base_n, v, n) what the hand leaves in sight
    bits : the same packed eight samples to a byte
    T_view, inside : (v, r, 4, 4), (v, r) of `views.view_poses` in the cell as given
    lying : stable poses that some grip takes up; the others are hopeless wherever things stand
    from_pose : (p, 2 base_n) which grips clear the table in each, from above
    odds : (p,) of these poses, adding to 1
    completes : (base_n, base_n) the second grip shows what the first one hides
    """

    prepared: PreparedPart
    weights: FloatArray
    vectors: FloatArray
    arm_grips: tuple[Grip, ...]
    fixture_grips: tuple[Grip, ...]
    shown: BoolArray
    bits: NDArray[np.uint8]
    T_view: FloatArray
    inside: BoolArray
    lying: tuple[StablePose, ...]
    from_pose: BoolArray
    odds: FloatArray
    completes: BoolArray

    @property
    def name(self) -> str:
        """Return what the part is called."""
        return self.prepared.solid.name

    @property
    def base_n(self) -> int:
        """Return how many grips there are, turned-over ones left out."""
        return len(self.shown)

    @property
    def showable(self) -> float:
        """Return the share of the surface that some grip and some direction show."""
        return float(self.weights[self.shown.any(axis=(0, 1))].sum())

    def share(self, packed: NDArray[np.uint8]) -> FloatArray:
        """Return the share of the surface of packed samples (..., bytes)."""
        bits = np.unpackbits(packed, axis=-1, count=len(self.weights))
        return np.asarray(bits @ self.weights)


def family_member(
    part: PreparedPart, layout: CellLayout, grips_n: int, fixture_n: int, directions_n: int
) -> FamilyMember:
    """Thin a prepared part to what a search over sites can afford.

    Parameters
    ----------
    grips_n, fixture_n : grips of either holder beside those that take resting parts up
    directions_n : square views first, as the part has them
    """
    solid = part.solid
    every = [g for g in part.arm_grips if not g.id.endswith("'")]
    base = select_arm_grips(solid, part.poses, every, layout.hand, PER_POSE_N, grips_n)
    fixed = [g for g in part.fixture_grips if not g.id.endswith("'")]
    fixed = [fixed[k] for k in spread(fixed, range(len(fixed)), fixture_n)]
    some = _some_directions(part.directions.square_to, directions_n)
    vectors = part.directions.vectors[some]
    visible = part.visible[some]
    far = standoff_mm(layout)
    shown = np.stack(
        [
            visible
            & ~hidden_by_hand(
                solid,
                part.samples,
                visible,
                vectors,
                far,
                g.T_part_hand,
                holding_boxes(layout.hand, g),
            )
            for g in base
        ]
    )
    arm_grips = (*base, *(turned_over(g) for g in base))
    T_view, inside = view_poses(solid, layout, vectors)
    poses = [p for p in part.poses if not p.rolling]
    from_pose = np.array(
        [clear_of_table(resting_pose(solid, p), arm_grips, layout.hand) for p in poses], dtype=bool
    ).reshape(len(poses), len(arm_grips))
    able = np.flatnonzero(from_pose.any(axis=1))
    odds = np.array([p.probability for p in poses])[able]
    weights = part.weights
    return FamilyMember(
        prepared=part,
        weights=weights,
        vectors=vectors,
        arm_grips=arm_grips,
        fixture_grips=(*fixed, *(turned_over(g) for g in fixed)),
        shown=shown,
        bits=np.packbits(shown, axis=2),
        T_view=T_view,
        inside=inside,
        lying=tuple(poses[k] for k in able.tolist()),
        from_pose=from_pose[able],
        odds=odds / odds.sum() if len(odds) else odds,
        completes=completing(np.asarray(shown.any(axis=1)), weights),
    )


def completing(shown_by_grip: BoolArray, weights: FloatArray) -> BoolArray:
    """Tell of each pair of grips (g, g) whether the second one shows what the first one hides.

    Parameters
    ----------
    shown_by_grip : (g, n) samples each grip shows from some side
    """
    total = float(weights[shown_by_grip.any(axis=0)].sum())
    both = shown_by_grip[:, None] | shown_by_grip[None]
    return np.asarray((both @ weights >= SHOWS_ALL * total) & ~np.eye(len(both), dtype=bool))


def _some_directions(square_to: IntArray, count: int) -> IntArray:
    """Return up to `count` of the directions: square ones, then evenly many of the sphere's."""
    square = np.flatnonzero(square_to >= 0)[:count]
    sphere = np.flatnonzero(square_to < 0)
    left = min(count - len(square), len(sphere))
    if left <= 0:
        return square
    pick = np.floor(np.arange(left) * len(sphere) / left).astype(int)
    return np.sort(np.concatenate([square, sphere[pick]]))


def hand_offsets_mm(members: Sequence[FamilyMember]) -> FloatArray:
    """Return where the centre of mass is in the hand, over all members' grips (k, 3)."""
    found = [
        inverse_pose(g.T_part_hand)[:3, :3] @ m.prepared.solid.centroid_mm
        + inverse_pose(g.T_part_hand)[:3, 3]
        for m in members
        for g in m.arm_grips[: m.base_n]
    ]
    return np.stack(found)
