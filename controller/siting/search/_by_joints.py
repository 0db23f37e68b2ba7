"""Rank the grids by the joints alone: camera sites, and poses of the fixed gripper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from controller.arrays import FloatArray
from controller.planning.model import CellLayout

from .._family import FamilyMember, tcp_offsets_mm
from ..checks.keepouts import why_not_here
from ..checks.reach import (
    TCP_DIRECTION_COUNT,
    hand_off_shares,
    meetings,
    met_grasps,
    nearest_directions,
    shown_directions,
    shown_share,
    sphere,
    table_views,
)
from ..score import PartScore, SiteScore, value_of
from ..site import CellSite, Fellows, placed_at, site_of, standoff_mm
from ..survey import Survey, site_key
from .grids import camera_grid, fixed_gripper_grid

# A site nearer than both to a better one is left to the small steps.
APART_MM, APART_DEG = 60.0, 20.0
MET_COUNT = 5  # grasps of the fixed gripper by which its poses are ranked
PAIRED_COUNT = 60  # fixed gripper poses tried with each camera site


def cameras_by_joints(search: Survey) -> list[SiteScore]:
    """Return the allowed camera sites of the grid, best first by the joints alone."""
    layout, members = search.layout, search.members
    now = site_of(layout)
    sites = list(camera_grid(layout)) if search.options.move_camera else []
    sites.insert(0, now)
    bare = (
        _without_fixed_gripper(layout, search.fellows)
        if search.options.move_fixed_gripper
        else layout
    )
    fellows = Fellows(
        search.fellows.camera, () if bare.fixed_gripper is None else search.fellows.fixed_gripper
    )
    keep = search.options.keep_free_mm
    to_camera = sphere(TCP_DIRECTION_COUNT)
    centre = tcp_offsets_mm(members).mean(axis=0)
    nearest = [nearest_directions(m, to_camera) for m in members]
    found = []
    for k, site in enumerate(sites):
        if k % 100 == 0:
            search.progress("camera sites", k, len(sites))
        why = why_not_here(
            placed_at(bare, site, fellows), fellows, None if keep is None else np.array(keep)
        )
        if why is not None and k > 0:
            continue
        reached = shown_directions(layout, site, to_camera, centre)
        scores = []
        for member, near in zip(members, nearest, strict=True):
            views = table_views(near, reached)
            scores.append(_by_joints(member, shown_share(member, views), float(views.mean())))
        found.append(SiteScore(site, tuple(scores), "joints", value_of(scores), why))
    search.tried_count += len(sites)
    return sorted(found, key=lambda s: (-round(s.value, 4), _far_mm(layout, s.site, now)))


@dataclass(frozen=True, slots=True, eq=False)
class FixedGripperScore:
    """A pose of the fixed gripper and the hand-offs that the joints alone allow there.

    Attributes
    ----------
    partners, joined : per part, `PartScore.partners_share` and `hand_offs_share`
    """

    T_world_fixed_tcp: FloatArray
    partners: tuple[float, ...]
    joined: tuple[float, ...]

    @property
    def value(self) -> float:
        """Its value: half the mean over the parts, half the worst part's."""
        each = 0.5 * (np.array(self.partners) + np.array(self.joined))
        return float(0.5 * each.mean() + 0.5 * each.min())


def fixed_grippers_by_joints(search: Survey) -> list[FixedGripperScore]:
    """Return the allowed poses of the fixed gripper, best first by the joints alone."""
    layout, members = search.layout, search.members
    if layout.fixed_gripper is None:
        return []
    poses = (
        list(fixed_gripper_grid(layout))
        if search.options.move_fixed_gripper
        else [layout.T_world_fixed_tcp]
    )
    now, bare = site_of(layout), layout
    if search.options.move_camera:
        kept = {n: b for n, b in layout.obstacles.items() if n not in search.fellows.camera}
        bare = replace(layout, obstacles=kept)
    fellows = Fellows((), search.fellows.fixed_gripper)
    keep = search.options.keep_free_mm
    together = [meetings(m, MET_COUNT) for m in members]
    found: list[FixedGripperScore] = []
    for k, T in enumerate(poses):
        if k % 100 == 0:
            search.progress("fixed gripper poses", k, len(poses))
        # if the camera moves, its picture is checked later, with each fixed gripper pose
        why = why_not_here(
            placed_at(bare, replace(now, T_world_fixed_tcp=T), fellows),
            fellows,
            None if keep is None else np.array(keep),
            look=not search.options.move_camera,
        )
        if why is not None and k > 0:
            continue
        shares = []
        for m, T_meet in zip(members, together, strict=True):
            met = met_grasps(layout, T, T_meet)
            shares.append(hand_off_shares(m, met[:, : m.base_count] | met[:, m.base_count :]))
        found.append(FixedGripperScore(T, tuple(s[0] for s in shares), tuple(s[1] for s in shares)))
    search.tried_count += len(poses)
    at = layout.T_world_fixed_tcp[:3, 3]

    def away_mm(score: FixedGripperScore) -> float:
        return round(float(np.linalg.norm(score.T_world_fixed_tcp[:3, 3] - at)), 3)

    return sorted(found, key=lambda f: (-round(f.value, 3), away_mm(f)))


def joined(
    search: Survey, cameras: Sequence[SiteScore], fixed_scores: Sequence[FixedGripperScore]
) -> list[SiteScore]:
    """Return camera sites, each with the best fixed gripper pose that goes with it, best first.

    The ranking is by the joints alone. The present site is among them; forbidden ones come last.

    Parameters
    ----------
    search : the cell, and what may stand where
    cameras : scores of sites, the present one among them
    fixed_scores : scores of poses of the fixed gripper, best first, the present one among them;
        empty if the cell has no fixed gripper
    """
    now = site_of(search.layout)
    kept = unlike([s.site for s in cameras], search.options.checked_cameras)
    wanted = [now, *[site for site in kept if site_key(site) != site_key(now)]]
    by_key = {site_key(s.site): s for s in cameras}
    found: list[SiteScore] = []
    for k, site in enumerate(wanted):
        score = by_key[site_key(site)]
        if not fixed_scores:
            found.append(score)
            continue
        if k == 0:
            found.append(
                _with_fixed_gripper(score, next(f for f in fixed_scores if _stands(f, now)))
            )
            found[0] = replace(found[0], forbidden=search.forbidden(now))
        for fixed_gripper in fixed_scores[:PAIRED_COUNT]:
            pair = replace(site, T_world_fixed_tcp=fixed_gripper.T_world_fixed_tcp)
            if site_key(pair) != site_key(now) and search.forbidden(pair) is None:
                found.append(_with_fixed_gripper(replace(score, forbidden=None), fixed_gripper))
                break
    return sorted(found, key=lambda s: (s.forbidden is not None, -s.value))


def _stands(fixed_gripper: FixedGripperScore, site: CellSite) -> bool:
    return site.T_world_fixed_tcp is not None and bool(
        np.allclose(fixed_gripper.T_world_fixed_tcp, site.T_world_fixed_tcp)
    )


def _with_fixed_gripper(score: SiteScore, fixed_gripper: FixedGripperScore) -> SiteScore:
    parts = tuple(
        replace(p, partners_share=a, hand_offs_share=b)
        for p, a, b in zip(score.parts, fixed_gripper.partners, fixed_gripper.joined, strict=True)
    )
    site = replace(score.site, T_world_fixed_tcp=fixed_gripper.T_world_fixed_tcp)
    return replace(score, site=site, parts=parts, value=value_of(parts))


def _by_joints(member: FamilyMember, shown: float, views_share: float) -> PartScore:
    nan = float("nan")
    return PartScore(
        member.name, member.showable, shown, shown, shown, views_share, 1.0, 1.0, 1.0, nan, nan
    )


def _without_fixed_gripper(layout: CellLayout, fellows: Fellows) -> CellLayout:
    kept = {n: b for n, b in layout.obstacles.items() if n not in fellows.fixed_gripper}
    return replace(layout, fixed_gripper=None, obstacles=kept)


def _far_mm(layout: CellLayout, a: CellSite, b: CellSite) -> float:
    """Return the distance of a site's station and camera from those of another one."""
    far = standoff_mm(layout)
    apart = np.linalg.norm(a.station_mm - b.station_mm)
    return round(float(apart + far * np.linalg.norm(a.towards - b.towards)), 3)


def unlike(sites: Sequence[CellSite], count: int) -> list[CellSite]:
    """Return the first sites, without those close to an earlier one."""
    kept: list[CellSite] = []
    for site in sites:
        if len(kept) >= count:
            break
        near = any(
            np.linalg.norm(site.station_mm - k.station_mm) < APART_MM
            and site.towards @ k.towards > np.cos(np.radians(APART_DEG))
            for k in kept
        )
        if not near:
            kept.append(site)
    return kept


def unlike_poses(poses: Sequence[FloatArray], count: int) -> list[FloatArray]:
    """Return the first fixed gripper poses, without those close to an earlier one."""
    kept: list[FloatArray] = []
    for T in poses:
        if len(kept) >= count:
            break
        near = any(
            np.linalg.norm(T[:3, 3] - k[:3, 3]) < 2 * APART_MM
            and np.trace(T[:3, :3].T @ k[:3, :3]) > 1 + 2 * np.cos(np.radians(APART_DEG))
            for k in kept
        )
        if not near:
            kept.append(T)
    return kept
