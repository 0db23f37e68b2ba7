"""A site with everything checked that a plan needs: collisions, sights, picks, hand-offs, trays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controller.cad import inverse_pose

from ..boxes import BoolArray
from ..grip import TABLE_MARGIN_MM, Grip
from ..grips import resting_pose
from ..layout import CellLayout, FloatArray
from ..motion import Scene, inverse_rows
from ..prepared import HandOff
from ..transfers import hand_offs
from ._family import FamilyMember
from ._reach import covered_bits, hand_off_shares
from ._score import PartScore, SiteScore, value_of
from ._seconds import forecast
from ._sight import links_in_sight
from ._site import Fellows, Site, carried, placed_at

TRIED_Q = 5  # configurations per grip and direction that get a collision check
PICK_MARGIN_MM = 2.0  # an empty hand creeping down to the part
PICK_TURNS_N = 6
PICK_LIFT_MM = 85.0
TRAY_Z_MM = (60.0, 160.0)
TRAY_TURNS_N = 12
TRAY_PITCHES_DEG = (-90.0, -60.0, -30.0)
TRAY_MARGIN_MM = 5.0


@dataclass(frozen=True, slots=True, eq=False)
class Shows:
    """What one part's grips show at a site.

    Attributes
    ----------
    views : (base_n, v) bool
    q : (base_n, v, 6) the quickest configuration free of contact, NaN where there is none
    """

    views: BoolArray
    q: FloatArray


def checked_views(site_layout: CellLayout, member: FamilyMember, move: FloatArray) -> Shows:
    """Return which (grip, view) pairs are free of contact with the arm out of the picture.

    Parameters
    ----------
    site_layout : with camera and fixture at the site
    move : (4, 4) of `carried`: from where the member's views were worked out to this site
    """
    half, speed = member.base_n, np.array(site_layout.pace.joint_per_s)
    q_best = np.full((half, len(member.vectors), 6), np.nan)
    best_s = np.full((half, len(member.vectors)), np.inf)
    radius_mm = float(
        np.linalg.norm(
            np.asarray(member.prepared.solid.mesh.convex_hull.vertices)
            - member.prepared.solid.centroid_mm,
            axis=1,
        ).max()
    )
    for k, grip in enumerate(member.arm_grips):
        base = k % half
        wanted = member.shown[base].any(axis=1)
        view, roll = np.nonzero(member.inside & wanted[:, None])
        if len(view) == 0:
            continue
        index, _, q = inverse_rows(site_layout, move @ member.T_view[view, roll] @ grip.T_part_hand)
        if len(index) == 0:
            continue
        away_s = (np.abs(q - site_layout.park_q) / speed).max(axis=1)
        order = np.lexsort((away_s, view[index]))
        of_view = view[index][order]
        place = np.arange(len(order)) - np.searchsorted(of_view, of_view)
        done = np.zeros(len(member.vectors), dtype=bool)
        scene = Scene(
            site_layout,
            grip.opening_mm,
            site_layout.fixture_open_mm,
            member.prepared.part_box.placed(inverse_pose(grip.T_part_hand)),
        )
        # most directions are free at the first try: the rest of the tries is for the others
        for turn in range(TRIED_Q):
            rows = order[(place == turn) & (away_s[order] < best_s[base, of_view])]
            rows = rows[~done[view[index[rows]]]]
            if len(rows) == 0:
                continue
            rows = rows[scene.free(q[rows])]
            rows = rows[~links_in_sight(site_layout, q[rows], radius_mm)]
            v = view[index[rows]]
            best_s[base, v], q_best[base, v], done[v] = away_s[rows], q[rows], True
    return Shows(np.isfinite(best_s), q_best)


def free_picks(site_layout: CellLayout, member: FamilyMember) -> BoolArray:
    """Return which grips take the part up where: (p poses, places, 2 base_n) bool."""
    (x0, x1), (y0, y1) = site_layout.set_down_mm
    places = [((x0 + x1) / 2, (y0 + y1) / 2), (x0, y0), (x0, y1), (x1, y0), (x1, y1)]
    turns = 2 * np.pi * np.arange(PICK_TURNS_N) / PICK_TURNS_N
    lying = member.lying
    found = np.zeros((len(lying), len(places) * len(turns), len(member.arm_grips)), dtype=bool)
    solid = member.prepared.solid
    for row, pose in enumerate(lying):
        T_rest = np.stack([resting_pose(solid, pose, x, y, t) for x, y in places for t in turns])
        for k in np.flatnonzero(member.from_pose[row]).tolist():
            grip = member.arm_grips[k]
            found[row, :, k] = _taken_up(site_layout, T_rest @ grip.T_part_hand, grip)
    return found


def _taken_up(layout: CellLayout, T_hold: FloatArray, grip: Grip) -> BoolArray:
    index, _, q = inverse_rows(layout, T_hold)
    found = np.zeros(len(T_hold), dtype=bool)
    if len(index) == 0:
        return found
    scene = Scene(layout, grip.pre_open_mm, layout.fixture_open_mm)
    free = scene.free(q, PICK_MARGIN_MM, table_margin_mm=TABLE_MARGIN_MM - 1e-6)
    found[index[free]] = True
    rows = np.flatnonzero(found)
    T_above = T_hold[rows].copy()
    T_above[:, :3, 3] -= PICK_LIFT_MM * T_hold[rows, :3, 0]
    found[:] = False
    index, _, q = inverse_rows(layout, T_above)
    if len(index):
        free = scene.free(q, PICK_MARGIN_MM, table_margin_mm=TABLE_MARGIN_MM - 1e-6)
        found[rows[index[free]]] = True
    return found


def tray_freedom(site_layout: CellLayout) -> dict[str, float]:
    """Return per tray the share of the hand's ways to be over it that touch nothing.

    Straight down and leaning, low over the tray's floor and where the part comes in. Nothing free
    is 0.0: the tray cannot be served.
    """
    scene = Scene(site_layout, site_layout.hand.max_mm, site_layout.fixture_open_mm)
    R = _hand_turns()
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


def _hand_turns() -> FloatArray:
    """Return hand rotations (n, 3, 3) straight down and leaning, jaws level."""
    found = []
    for pitch in np.radians(TRAY_PITCHES_DEG):
        for heading in 2 * np.pi * np.arange(TRAY_TURNS_N) / TRAY_TURNS_N:
            ahead = np.array([np.cos(heading), np.sin(heading), 0.0])
            x = np.cos(pitch) * ahead + np.array([0.0, 0.0, np.sin(pitch)])
            y = np.array([-ahead[1], ahead[0], 0.0])
            for side in (y, -y):
                found.append(np.column_stack([x, side, np.cross(x, side)]))
    return np.stack(found)


def checked_hand_offs(
    site_layout: CellLayout, member: FamilyMember
) -> tuple[BoolArray, list[dict[int, HandOff]]]:
    """Return which base grips can meet which of the fixture's (f, base_n), and how."""
    half = member.base_n
    if site_layout.fixture is None or not member.fixture_grips:
        return np.zeros((0, half), dtype=bool), []
    tables = [
        dict(hand_offs(site_layout, member.prepared.part_box, f, member.arm_grips))
        for f in member.fixture_grips
    ]
    met = np.zeros((len(tables), half), dtype=bool)
    for row, table in enumerate(tables):
        for g in table:
            met[row, g % half] = True
    return met, tables


def passed_on(start: BoolArray, met: BoolArray) -> BoolArray:
    """Return which grips (g,) can be come by from some (g,), over any number of hand-offs."""
    held = start.copy()
    while True:
        through = met[(met & held).any(axis=1)].any(axis=0) | held
        if (through == held).all():
            return held
        held = through


def score_site(
    layout: CellLayout,
    site: Site,
    fellows: Fellows,
    members: Sequence[FamilyMember],
    joints: Sequence[float],
) -> SiteScore:
    """Return the score of one site with everything checked.

    Parameters
    ----------
    layout : the cell the members were made for
    joints : what the joints alone allow here, per member (`shown_share` of `reached_views`)
    """
    here = placed_at(layout, site, fellows)
    move = carried(layout, site)
    parts = [_score_part(here, member, move, j) for member, j in zip(members, joints, strict=True)]
    trays = tray_freedom(here)
    return SiteScore(site, tuple(parts), "checked", value_of(parts, trays), None, trays)


def _score_part(
    here: CellLayout, member: FamilyMember, move: FloatArray, joints_allow: float
) -> PartScore:
    shows = checked_views(here, member, move)
    covered = covered_bits(member, shows.views)
    met, tables = checked_hand_offs(here, member)
    picks = free_picks(here, member)
    half = member.base_n
    by_pose: BoolArray = np.asarray(picks.any(axis=1))
    by_pose = by_pose[:, :half] | by_pose[:, half:]
    shown = np.zeros(len(by_pose))
    for row, start in enumerate(by_pose):
        held = passed_on(start, met)
        if held.any():
            shown[row] = float(member.share(np.bitwise_or.reduce(covered[held], axis=0)))
    partners, joined = hand_off_shares(member, met)
    worth = member.shown.any(axis=2)
    view_s, regrip_s = forecast(here, member, shows.views, shows.q, by_pose, met, tables)
    return PartScore(
        name=member.name,
        showable=member.showable,
        joints_allow=joints_allow,
        shown=float(shown @ member.odds) if len(shown) else 0.0,
        shown_worst=float(shown.min()) if len(shown) else 0.0,
        views_share=float((shows.views & worth).sum() / max(worth.sum(), 1)),
        partners_share=partners,
        hand_offs_share=joined,
        picks_share=float(picks.any(axis=2).mean(axis=1) @ member.odds) if len(picks) else 0.0,
        view_s=view_s,
        regrip_s=regrip_s,
    )


__all__ = ["checked_views", "free_picks", "passed_on", "score_site", "tray_freedom"]
