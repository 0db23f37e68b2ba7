"""Check all that a plan needs of a site: collisions, visibility, picks, hand-offs, trays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.imaging import inverse_pose
from controller.planning.model import CellLayout, Grasp, HandOff
from controller.planning.motion import Scene, inverse_rows
from controller.planning.regrasps import hand_offs

from .._family import FamilyMember
from ..score import PartScore, SiteScore, value_of
from ..site import CellSite, Fellows, carried, placed_at
from ._seconds import forecast
from .reach import covered_bits, hand_off_shares, shown_share
from .visibility import links_in_sight

TRIED_Q = 5  # configurations per grasp and direction that get a collision check
PICK_MARGIN_MM = 2.0  # clearance of an empty gripper that moves down slowly to the part
TRAY_Z_MM = (60.0, 160.0)
TRAY_TURN_COUNT = 12
TRAY_PITCHES_DEG = (-90.0, -60.0, -30.0)
TRAY_MARGIN_MM = 5.0


@dataclass(frozen=True, slots=True, eq=False)
class Shows:
    """Coverage of one part's grasps at a site.

    Attributes
    ----------
    reached : (base_count, v) bool, by the joints alone
    views : (base_count, v) bool, also free of contact and with the arm out of the picture
    q : (base_count, v, 6) one configuration each, NaN if there is none
    """

    reached: BoolArray
    views: BoolArray
    q: FloatArray


def checked_views(site_layout: CellLayout, member: FamilyMember, move: FloatArray) -> Shows:
    """Return which (grasp, view) pairs are free of contact with the arm out of the picture.

    Parameters
    ----------
    site_layout : with camera and fixed gripper at the site
    member : a part of the family
    move : (4, 4) of `carried`: from the site for which the member's views were computed to this one
    """
    half = member.base_count
    q_free = np.full((half, len(member.vectors), 6), np.nan)
    reached = np.zeros((half, len(member.vectors)), dtype=bool)
    T_view = move @ member.T_view
    rolls = np.arange(member.inside.shape[1])
    for base in range(half):
        left = member.shown[base].any(axis=1)
        # Half the rolls, then the other half, then both with the arm gripper turned over. Most
        # directions are free at the first try; only the rest go on to the next one.
        for grasp in (member.arm_grasps[base], member.arm_grasps[base + half]):
            for some in (rolls % 2 == 0, rolls % 2 == 1):
                view, roll = np.nonzero(member.inside & left[:, None] & some)
                if len(view):
                    found = _first_free(site_layout, member, grasp, T_view[view, roll], view)
                    reached[base, found[0]] = True
                    q_free[base, found[1]] = found[2]
                    left[found[1]] = False
    return Shows(reached, np.isfinite(q_free[:, :, 0]), q_free)


def _first_free(
    layout: CellLayout, member: FamilyMember, grasp: Grasp, T_part: FloatArray, view: IntArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return views that the joints reach, the free ones of these, and their q: (a,), (b,), (b, 6).

    Parameters
    ----------
    T_part : (n, 4, 4) poses of the part in front of the camera, one for each of the views (n,)
    """
    index, _, q = inverse_rows(layout, T_part @ grasp.T_part_tcp)
    if len(index) == 0:
        return view[index], view[index], q
    speed = layout.arm.timing.joint_speeds
    away_s = (np.abs(q - layout.park_q) / speed).max(axis=1)
    order = np.lexsort((away_s, view[index]))
    of_view = view[index][order]
    place = np.arange(len(order)) - np.searchsorted(of_view, of_view)
    scene = Scene(
        layout,
        grasp.opening_mm,
        layout.fixed_open_mm,
        member.prepared.part_box.placed(inverse_pose(grasp.T_part_tcp)),
    )
    free_rows = np.zeros(0, dtype=np.int64)
    for tried in (place == 0, (place > 0) & (place < TRIED_Q)):
        rows = order[tried & ~np.isin(of_view, view[index[free_rows]])]
        rows = rows[scene.free(q[rows])]
        rows = rows[~links_in_sight(layout, q[rows], member.radius_mm)]
        _, first = np.unique(view[index[rows]], return_index=True)
        free_rows = np.concatenate([free_rows, rows[first]])
    return np.unique(view[index]), view[index[free_rows]], q[free_rows]


def free_picks(site_layout: CellLayout, member: FamilyMember) -> BoolArray:
    """Return which grasps pick the part up where: (p poses, places, 2 base_count) bool."""
    picks = member.picks
    found = np.zeros(
        (len(member.start_poses), picks.place_count, len(member.arm_grasps)), dtype=bool
    )
    if len(picks.q_hold) == 0:
        return found
    # The arm gripper is taken as wide open. A grasp that must open less in some pose is not lost.
    scene = Scene(site_layout, site_layout.arm_gripper.max_mm, site_layout.fixed_open_mm)
    q = np.concatenate([picks.q_hold, picks.q_above])
    free = ~_touches(scene, q).reshape(2, -1).any(axis=0)
    found[picks.pose[free], picks.place[free], picks.grasp[free]] = True
    return found


def _touches(scene: Scene, q: FloatArray) -> BoolArray:
    """Return which configurations (n, 6) touch anything in the cell except the table.

    Clearance from the table was checked when the picks were listed.
    """
    contacts = scene.contacts(q, PICK_MARGIN_MM, table_margin_mm=-1e6)
    return np.asarray(contacts >= 0)


def tray_freedom(site_layout: CellLayout) -> dict[str, float]:
    """Return per tray the share of the arm gripper's poses over it that touch nothing.

    The poses point straight down and lean, low over the tray's floor and where the part comes in.
    At 0.0 the tray cannot be served.
    """
    scene = Scene(site_layout, site_layout.arm_gripper.max_mm, site_layout.fixed_open_mm)
    R = _gripper_turns()
    out: dict[str, float] = {}
    for name, tray in site_layout.trays.items():
        shares = []
        for z in TRAY_Z_MM:
            T = np.zeros((len(R), 4, 4))
            T[:, 3, 3], T[:, :3, :3], T[:, 2, 3] = 1.0, R, z
            T[:, 0, 3], T[:, 1, 3] = tray.centre_mm
            _, _, q = inverse_rows(site_layout, T)
            shares.append(float(scene.free(q, TRAY_MARGIN_MM).mean()) if len(q) else 0.0)
        out[name] = min(shares)
    return out


def _gripper_turns() -> FloatArray:
    """Return gripper rotations (n, 3, 3) straight down and leaning, jaws level."""
    found = []
    for pitch in np.radians(TRAY_PITCHES_DEG):
        for heading in 2 * np.pi * np.arange(TRAY_TURN_COUNT) / TRAY_TURN_COUNT:
            ahead = np.array([np.cos(heading), np.sin(heading), 0.0])
            x = np.cos(pitch) * ahead + np.array([0.0, 0.0, np.sin(pitch)])
            y = np.array([-ahead[1], ahead[0], 0.0])
            for side in (y, -y):
                found.append(np.column_stack([x, side, np.cross(x, side)]))
    return np.stack(found)


def checked_hand_offs(
    site_layout: CellLayout, member: FamilyMember
) -> tuple[BoolArray, list[dict[int, HandOff]]]:
    """Return which base grasps can meet which fixed ones (f, base_count), and the hand-offs."""
    half = member.base_count
    if site_layout.fixed_gripper is None or not member.fixed_grasps:
        return np.zeros((0, half), dtype=bool), []
    tables = [
        dict(hand_offs(site_layout, member.prepared.shape, f, member.arm_grasps))
        for f in member.fixed_grasps
    ]
    met = np.zeros((len(tables), half), dtype=bool)
    for row, table in enumerate(tables):
        for g in table:
            met[row, g % half] = True
    return met, tables


def passed_on(start: BoolArray, met: BoolArray) -> BoolArray:
    """Return which grasps (g,) can be reached from some (g,) by any number of hand-offs."""
    held = start.copy()
    while True:
        through = met[(met & held).any(axis=1)].any(axis=0) | held
        if (through == held).all():
            return held
        held = through


def score_site(
    layout: CellLayout,
    site: CellSite,
    fellows: Fellows,
    members: Sequence[FamilyMember],
) -> SiteScore:
    """Return the score of a site with everything checked.

    Parameters
    ----------
    layout : the cell the members were made for
    site : site to score
    fellows : obstacles that move with camera and fixed gripper
    members : the family
    """
    here = placed_at(layout, site, fellows)
    move = carried(layout, site)
    parts = [_score_part(here, member, move) for member in members]
    trays = tray_freedom(here)
    return SiteScore(site, tuple(parts), "checked", value_of(parts, trays), None, trays)


def _score_part(here: CellLayout, member: FamilyMember, move: FloatArray) -> PartScore:
    shows = checked_views(here, member, move)
    covered = covered_bits(member, shows.views)
    met, tables = checked_hand_offs(here, member)
    picks = free_picks(here, member)
    half = member.base_count
    by_pose: BoolArray = np.asarray(picks.any(axis=1))
    by_pose = by_pose[:, :half] | by_pose[:, half:]
    shown = np.zeros(len(by_pose))
    for row, start in enumerate(by_pose):
        held = passed_on(start, met)
        if held.any():
            shown[row] = float(member.share(np.bitwise_or.reduce(covered[held], axis=0)))
    partners, joined = hand_off_shares(member, met)
    worth = member.shown.any(axis=2)
    view_s, regrasp_s = forecast(here, member, shows.views, shows.q, by_pose, met, tables)
    return PartScore(
        name=member.name,
        showable=member.showable,
        joints_allow=shown_share(member, shows.reached),
        shown=float(shown @ member.probabilities) if len(shown) else 0.0,
        shown_worst=float(shown.min()) if len(shown) else 0.0,
        views_share=float((shows.views & worth).sum() / max(worth.sum(), 1)),
        partners_share=partners,
        hand_offs_share=joined,
        picks_share=float(picks.any(axis=2).mean(axis=1) @ member.probabilities)
        if len(picks)
        else 0.0,
        view_s=view_s,
        regrasp_s=regrasp_s,
    )


__all__ = ["checked_views", "free_picks", "passed_on", "score_site", "tray_freedom"]
