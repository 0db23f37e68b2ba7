"""Search sites: a grid by the joints alone, its best with everything checked, then small steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from controller.planning.model import CellLayout, PreparedPart

from ..score import SiteOptions, SiteScore
from ..site import CellSite, site_of
from ..survey import Progress, Survey, survey
from ._by_joints import cameras_by_joints, fixed_grippers_by_joints, joined, unlike, unlike_poses
from .grids import camera_steps, fixed_gripper_steps

STEP_MM, STEP_DEG = 40.0, 15.0  # of the first round; each later one is half as wide
FIXED_ROUNDS = 2  # camera sites with which every fixed gripper pose is tried
BETTER = 2e-4  # least gain of a step; with less, steps would wander about a plateau


def find_sites(
    parts: Sequence[PreparedPart],
    layout: CellLayout,
    options: SiteOptions | None = None,
    progress: Progress | None = None,
) -> tuple[SiteScore, ...]:
    """Return sites of camera and fixed gripper for a family of parts, best first.

    The present site is among them. There are three stages: a grid by the joints alone; its best
    sites with collisions, visibility, picks and hand-offs; small steps about the best of these.
    Work is limited by counts and not by time, so the same cell and parts give the same sites.

    Parameters
    ----------
    parts : results of `prepare_part` in this layout
    layout : arm, table and overhead camera stay; the camera keeps its distance from the station
    options : extent of the search; None for the defaults
    progress : called with the name of the step, steps done and steps in all

    Raises
    ------
    ValueError : no part
    """
    return search_sites(survey(parts, layout, options, progress))


def search_sites(search: Survey) -> tuple[SiteScore, ...]:
    """Return the sites that the stages of `find_sites` find."""
    options, now = search.options, site_of(search.layout)
    by_joints = cameras_by_joints(search)
    cameras = unlike([s.site for s in by_joints], options.checked_cameras)
    fixed_scores = fixed_grippers_by_joints(search)
    if options.joints_only:
        return tuple(joined(search, by_joints, fixed_scores))
    few = unlike_poses([f.T_world_fixed_tcp for f in fixed_scores], options.checked_fixed_poses)

    best = search.check(now)
    for k, camera in enumerate(cameras):
        search.progress("camera sites checked", k, len(cameras))
        for T in [search.layout.T_world_fixed_tcp, *few]:
            site = replace(camera, T_world_fixed_tcp=T if search.layout.fixed_gripper else None)
            if search.forbidden(site) is None:
                best = _better(best, search.check(site))
                break
    ranked = unlike([s.site for s in _ranked(search)], FIXED_ROUNDS)
    for k, camera in enumerate(ranked):
        for i, T in enumerate(few):
            search.progress("fixed gripper poses checked", k * len(few) + i, len(few) * len(ranked))
            site = replace(camera, T_world_fixed_tcp=T)
            if search.forbidden(site) is None:
                best = _better(best, search.check(site))
    for turn in range(options.local_steps):
        best = _step_about(search, best, STEP_MM / 2**turn, STEP_DEG / 2**turn, turn)
    return tuple(_ranked(search))


def _ranked(search: Survey) -> list[SiteScore]:
    """Return all checked sites, best first; of equals the present one comes first."""
    return sorted(search.checked.values(), key=lambda s: (s.forbidden is not None, -s.value))


def _step_about(
    search: Survey, best: SiteScore, step_mm: float, step_deg: float, turn: int
) -> SiteScore:
    options = search.options
    steps = list(camera_steps(best.site, step_mm, step_deg)) if options.move_camera else []
    if options.move_fixed_gripper:
        steps += list(fixed_gripper_steps(best.site, step_mm, step_deg))
    start = best
    for k, site in enumerate(steps):
        search.progress(f"small steps, round {turn + 1}", k, len(steps))
        if search.forbidden(site) is None:
            best = _better(best, search.check(site))
    if best is not start and best.value > start.value + BETTER:
        # repeat the step as long as it gains
        while True:
            onward = _onward(start.site, best.site)
            if onward is None or search.forbidden(onward) is not None:
                break
            further = search.check(onward)
            if further.value <= best.value + BETTER:
                break
            start, best = best, further
    return best


def _onward(before: CellSite, after: CellSite) -> CellSite | None:
    """Return the site one more equal shift along; None if the step was a turn."""
    shift = after.station_mm - before.station_mm
    if np.linalg.norm(shift) > 1e-6:
        return replace(after, station_mm=after.station_mm + shift)
    if before.T_world_fixed_tcp is not None and after.T_world_fixed_tcp is not None:
        offset = after.T_world_fixed_tcp[:3, 3] - before.T_world_fixed_tcp[:3, 3]
        if np.linalg.norm(offset) > 1e-6:
            T = after.T_world_fixed_tcp.copy()
            T[:3, 3] += offset
            return replace(after, T_world_fixed_tcp=T)
    return None


def _better(best: SiteScore, other: SiteScore) -> SiteScore:
    if other.forbidden is not None:
        return best
    return other if best.forbidden is not None or other.value > best.value + BETTER else best
