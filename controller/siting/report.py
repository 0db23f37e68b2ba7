"""Report the result in figures and sentences, for the person who bolts the camera down."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controller.arrays import FloatArray
from controller.planning.geometry import Box
from controller.planning.model import CellLayout, PreparedPart

from .score import SiteOptions, SiteScore
from .search.sites import search_sites
from .site import CellSite, carried, fellows_of, placed_at, site_of
from .survey import Progress, site_key, survey

SAME_MM, SAME_DEG = 1.0, 0.5  # nobody places a camera or a gripper more exactly by hand
TURN_MM = 5.0  # a turn by one degree counts as a move by this much
MIN_PICKS = 0.01  # share of the places on the table; a smaller difference is noise


@dataclass(frozen=True, slots=True, eq=False)
class SiteReport:
    """Best poses of camera and fixed gripper, and the gain from moving them.

    Attributes
    ----------
    present, best : scores for the same parts, all checked; `best` is, of the sites as good as the
        best, the one that needs the smallest moves
    others : the next best sites, far from the best one
    joints_allow : mean share of the surface that the joints alone allow, the camera anywhere
    stay : the present site is as good as the best found
    sites_tried, sites_checked : count of sites of the grid, and of those with everything checked
    T_camera : (4, 4) pose of the camera at the best site
    move : (4, 4) rigid motion there of all that belongs to the camera, its lamps included
    boxes : obstacles that move with camera or fixed gripper, in their new place
    sentences : the result in words
    """

    present: SiteScore
    best: SiteScore
    others: tuple[SiteScore, ...]
    joints_allow: float
    stay: bool
    sites_tried: int
    sites_checked: int
    T_camera: FloatArray
    move: FloatArray
    boxes: dict[str, Box]
    sentences: tuple[str, ...]


def site_report(
    parts: Sequence[PreparedPart],
    layout: CellLayout,
    options: SiteOptions | None = None,
    progress: Progress | None = None,
) -> SiteReport:
    """Search sites for a family of parts and return the report.

    Parameters
    ----------
    parts : results of `prepare_part` in this layout
    layout : the cell as it stands
    options : extent of the search, and noise level; None for the defaults
    progress : called with the name of the step, steps done and steps in all

    Raises
    ------
    ValueError : no part
    """
    search = survey(parts, layout, options, progress)
    found = search_sites(search)
    now = site_key(site_of(layout))
    present = next(s for s in found if site_key(s.site) == now)
    best = least_moved(found, present, search.options.as_good)
    why = reasons_to_move(present, best, search.options)
    others = _unlike_best(best, found)
    here = placed_at(layout, best.site, fellows_of(layout))
    moving = (*search.fellows.camera, *search.fellows.fixed_gripper)
    return SiteReport(
        present=present,
        best=best,
        others=others,
        joints_allow=max(s.joints_allow for s in found),
        stay=not why,
        sites_tried=search.tried_count,
        sites_checked=len(found),
        T_camera=here.inspection.T_world_cam,
        move=carried(layout, best.site),
        boxes={name: here.obstacles[name] for name in moving},
        sentences=_sentences(present, best, why, max(s.joints_allow for s in found)),
    )


def reasons_to_move(present: SiteScore, best: SiteScore, options: SiteOptions) -> tuple[str, ...]:
    """Return the advantages of the best site over the present one, noise left out; () if none.

    Parameters
    ----------
    present : the present site; the same object as ``best`` if nothing is better
    best : the best site found
    options : noise levels
    """
    if best is present:
        return ()
    why: list[str] = []
    if present.forbidden is not None:
        why.append(f"as it stands, {present.forbidden}")
    gain = best.shown_mean - present.shown_mean
    if gain >= options.worth_moving:
        why.append(f"it shows {100 * gain:.1f} % more of the surface")
    worst = best.shown_worst - present.shown_worst
    if worst >= options.worth_moving:
        why.append(f"it shows {100 * worst:.1f} % more of the worst part in its worst pose")
    picks = best.mean("picks_share") - present.mean("picks_share")
    if picks >= MIN_PICKS:
        why.append(f"parts can be picked up in {100 * picks:.0f} % more of the places")
    for name, free in present.trays.items():
        if free == 0.0 and best.trays.get(name, 0.0) > 0.0:
            why.append(f"the tray {name} can be served")
    partners = best.mean("partners_share") - present.mean("partners_share")
    if partners >= options.worth_moving_hand_offs:
        why.append(
            f"one hand-off shows the rest from {100 * best.mean('partners_share'):.0f} % of the "
            f"grasps instead of {100 * present.mean('partners_share'):.0f} %"
        )
    for name, free in present.trays.items():
        more = best.trays.get(name, 0.0) - free
        if free > 0.0 and more >= options.worth_moving_hand_offs:
            why.append(
                f"over the tray {name}, {100 * best.trays[name]:.0f} % of the gripper's poses are "
                f"clear instead of {100 * free:.0f} %"
            )
    before, after = seconds_of(present), seconds_of(best)
    if np.isfinite(before) and after < before * (1.0 - options.worth_moving_s):
        why.append(f"views and regrasp take about {after:.0f} s instead of {before:.0f} s a part")
    return tuple(why)


def seconds_of(score: SiteScore) -> float:
    """Return the mean estimate of views and regrasp [s]; NaN if no part can be shown."""
    regrasp = score.mean("regrasp_s")
    return score.mean("view_s") + (regrasp if np.isfinite(regrasp) else 0.0)


def least_moved(found: Sequence[SiteScore], present: SiteScore, as_good: float) -> SiteScore:
    """Return, of the sites as good as the best, the one that needs the smallest moves.

    Parameters
    ----------
    found : best first
    present : the present site
    as_good : a site's value may be this much less than the best one's
    """
    equals = [s for s in found if s.forbidden is None and s.value >= found[0].value - as_good] or [
        found[0]
    ]
    return min(equals, key=lambda s: (moved_mm(present.site, s.site), -s.value))


def moved_mm(a: CellSite, b: CellSite) -> float:
    """Return the distance that station, camera and fixed gripper move; a degree counts as 5 mm."""
    moved = float(np.linalg.norm(a.station_mm - b.station_mm))
    moved += TURN_MM * _angle_deg(float(a.towards @ b.towards))
    if a.T_world_fixed_tcp is not None and b.T_world_fixed_tcp is not None:
        T_a, T_b = a.T_world_fixed_tcp, b.T_world_fixed_tcp
        moved += float(np.linalg.norm(T_a[:3, 3] - T_b[:3, 3]))
        moved += TURN_MM * _angle_deg((float(np.trace(T_a[:3, :3].T @ T_b[:3, :3])) - 1.0) / 2.0)
    return round(moved, 3)


def _angle_deg(cosine: float) -> float:
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _unlike_best(
    best: SiteScore, found: Sequence[SiteScore], count: int = 4
) -> tuple[SiteScore, ...]:
    kept = [best]
    for score in found:
        if score.forbidden is None and all(not _close(score.site, k.site) for k in kept):
            kept.append(score)
        if len(kept) > count:
            break
    return tuple(kept[1:])


def _close(a: CellSite, b: CellSite, mm: float = 100.0, deg: float = 30.0) -> bool:
    near = bool(np.linalg.norm(a.station_mm - b.station_mm) < mm)
    near &= bool(a.towards @ b.towards > np.cos(np.radians(deg)))
    if a.T_world_fixed_tcp is not None and b.T_world_fixed_tcp is not None:
        offset = a.T_world_fixed_tcp[:3, 3] - b.T_world_fixed_tcp[:3, 3]
        turn = np.trace(a.T_world_fixed_tcp[:3, :3].T @ b.T_world_fixed_tcp[:3, :3])
        near &= bool(np.linalg.norm(offset) < mm and turn > 1 + 2 * np.cos(np.radians(deg)))
    return near


def camera_words(site: CellSite) -> str:
    """Return the direction and the target point of the camera, in words."""
    return f"look along {along(site.looks_along)} at {_at(site.station_mm)}"


def fixed_gripper_words(T: FloatArray) -> str:
    """Return position and direction of the fixed gripper's fingertips, in words."""
    return (
        f"stand with its tips at {_at(T[:3, 3])}, pointing along {along(T[:3, 0])}, "
        f"its jaws closing along {along(T[:3, 1])}"
    )


def along(v: FloatArray) -> str:
    """Return a direction as "+y", or as azimuth from x and height over the table in degrees."""
    k = int(np.argmax(np.abs(v)))
    if abs(v[k]) > np.cos(np.radians(SAME_DEG)):
        return f"{'+' if v[k] > 0 else '-'}{'xyz'[k]}"
    azimuth = np.degrees(np.arctan2(v[1], v[0]))
    height = np.degrees(np.arcsin(np.clip(v[2], -1.0, 1.0)))
    return f"azimuth {azimuth:.0f} deg, {abs(height):.0f} deg {'up' if height >= 0 else 'down'}"


def _at(p: FloatArray) -> str:
    return "(" + ", ".join(f"{v:.0f}" for v in p) + ")"


def _figures(score: SiteScore) -> str:
    text = (
        f"{100 * score.shown_mean:.1f} % of the surface is shown "
        f"({100 * score.shown_worst:.1f} % of the worst part in its worst pose)"
    )
    if any(np.isfinite(p.regrasp_s) for p in score.parts):
        text += (
            f", one hand-off shows the rest from {100 * score.mean('partners_share'):.0f} % of the "
            f"grasps, views and regrasp take about {seconds_of(score):.0f} s"
        )
    return text


def _sentences(
    present: SiteScore, best: SiteScore, why: Sequence[str], joints_allow: float
) -> tuple[str, ...]:
    if present.stage == "joints":
        said = [f"By the joints alone, nothing checked for contact: {_figures(present)}."]
    else:
        said = [
            f"As it stands, {_figures(present)}; the joints alone would allow "
            f"{100 * joints_allow:.1f} % with the camera anywhere."
        ]
    if not why:
        said.append(
            "Leave camera and fixed gripper where they are: no site found is better by more than "
            "the search can resolve."
        )
        return tuple(said)
    camera_moves = np.linalg.norm(
        present.site.station_mm - best.site.station_mm
    ) > SAME_MM or present.site.towards @ best.site.towards < np.cos(np.radians(SAME_DEG))
    if camera_moves:
        said.append(
            f"The camera should {camera_words(best.site)}; now it looks along "
            f"{along(present.site.looks_along)} at {_at(present.site.station_mm)}."
        )
    else:
        said.append("The camera stands well where it is.")
    T, T_now = best.site.T_world_fixed_tcp, present.site.T_world_fixed_tcp
    if T is not None and T_now is not None:
        turned = np.trace(T[:3, :3].T @ T_now[:3, :3]) < 1 + 2 * np.cos(np.radians(SAME_DEG))
        if np.linalg.norm(T[:3, 3] - T_now[:3, 3]) > SAME_MM or turned:
            said.append(f"The fixed gripper should {fixed_gripper_words(T)}.")
        else:
            said.append("The fixed gripper stands well where it is.")
    said.append(f"There, {_figures(best)}: " + "; ".join(why) + ".")
    return tuple(said)
