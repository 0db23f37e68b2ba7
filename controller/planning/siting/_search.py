"""The search: a grid by the joints alone, its best with everything checked, then small steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..layout import CellLayout, FloatArray
from ..prepared import PreparedPart
from ._checked import score_site
from ._family import FamilyMember, family_member, hand_offsets_mm
from ._grids import camera_grid, camera_steps, fixture_grid, fixture_steps
from ._keepouts import why_not_here
from ._reach import (
    HAND_DIRECTIONS_N,
    hand_off_shares,
    meetings,
    met_grips,
    nearest_in_hand,
    shown_directions,
    shown_share,
    sphere,
    table_views,
)
from ._score import PartScore, SiteOptions, SiteScore, value_of
from ._site import Fellows, Site, fellows_of, placed_at, site_of, standoff_mm

Progress = Callable[[str, int, int], None]  # what is being done, steps done, steps in all
APART_MM, APART_DEG = 60.0, 20.0  # sites nearer than both to a better one are left to small steps
STEP_MM, STEP_DEG = 40.0, 15.0  # of the first round; each later one is half as wide
FIXTURE_ROUNDS = 2  # camera sites with which every fixture pose is tried
PAIRED_N = 60  # fixture poses tried with each camera site by the joints alone
BETTER = 2e-4  # less is no improvement: steps would wander about a plateau


def _quiet(what: str, done: int, total: int) -> None:
    return None


@dataclass(slots=True, eq=False)
class Survey:
    """One search: the cell, the family, and every site checked so far.

    Kept as an object because all stages share the members and what has been checked already.
    """

    layout: CellLayout
    members: tuple[FamilyMember, ...]
    options: SiteOptions
    fellows: Fellows
    progress: Progress = _quiet
    checked: dict[tuple[int, ...], SiteScore] = field(default_factory=dict)
    tried_n: int = 0

    def forbidden(self, site: Site) -> str | None:
        """Return what forbids a site, None if nothing."""
        keep = self.options.keep_free_mm
        return why_not_here(
            placed_at(self.layout, site, self.fellows),
            self.fellows,
            None if keep is None else np.array(keep),
        )

    def check(self, site: Site) -> SiteScore:
        """Return the full score of a site, worked out once."""
        key = site_key(site)
        if key not in self.checked:
            score = score_site(self.layout, site, self.fellows, self.members)
            self.checked[key] = replace(score, forbidden=self.forbidden(site))
        return self.checked[key]


def survey(
    parts: Sequence[PreparedPart],
    layout: CellLayout,
    options: SiteOptions | None = None,
    progress: Progress | None = None,
) -> Survey:
    """Return a search over sites, ready to begin.

    Raises
    ------
    ValueError : no part
    """
    if not parts:
        raise ValueError("siting needs at least one part")
    options = options or SiteOptions()
    tell = progress or _quiet
    members = []
    for k, part in enumerate(parts):
        tell("parts", k, len(parts))
        members.append(
            family_member(
                part, layout, options.arm_grips, options.fixture_grips, options.directions
            )
        )
    return Survey(layout, tuple(members), options, fellows_of(layout), tell)


def cameras_by_joints(search: Survey) -> list[SiteScore]:
    """Return the camera sites of the grid that are allowed, best first by the joints alone."""
    layout, members = search.layout, search.members
    now = site_of(layout)
    sites = list(camera_grid(layout)) if search.options.move_camera else []
    sites.insert(0, now)
    bare = _without_fixture(layout, search.fellows) if search.options.move_fixture else layout
    fellows = Fellows(search.fellows.camera, () if bare.fixture is None else search.fellows.fixture)
    keep = search.options.keep_free_mm
    in_hand = sphere(HAND_DIRECTIONS_N)
    centre = hand_offsets_mm(members).mean(axis=0)
    nearest = [nearest_in_hand(m, in_hand) for m in members]
    found = []
    for k, site in enumerate(sites):
        if k % 100 == 0:
            search.progress("camera sites", k, len(sites))
        why = why_not_here(
            placed_at(bare, site, fellows), fellows, None if keep is None else np.array(keep)
        )
        if why is not None and k > 0:
            continue
        reached = shown_directions(layout, site, in_hand, centre)
        scores = []
        for member, near in zip(members, nearest, strict=True):
            views = table_views(near, reached)
            scores.append(_by_joints(member, shown_share(member, views), float(views.mean())))
        found.append(SiteScore(site, tuple(scores), "joints", value_of(scores), why))
    search.tried_n += len(sites)
    return sorted(found, key=lambda s: (-round(s.value, 4), _far_mm(layout, s.site, now)))


@dataclass(frozen=True, slots=True, eq=False)
class FixtureScore:
    """A pose of the fixed gripper and what the joints alone let it take and give.

    Attributes
    ----------
    partners, joined : per part, `PartScore.partners_share` and `hand_offs_share`
    """

    T_world_fixture: FloatArray
    partners: tuple[float, ...]
    joined: tuple[float, ...]

    @property
    def value(self) -> float:
        """Return what it is worth: half its mean over the parts, half its worst."""
        each = 0.5 * (np.array(self.partners) + np.array(self.joined))
        return float(0.5 * each.mean() + 0.5 * each.min())


def fixtures_by_joints(search: Survey) -> list[FixtureScore]:
    """Return the allowed poses of the fixed gripper, best first by the joints alone."""
    layout, members = search.layout, search.members
    if layout.fixture is None:
        return []
    poses = list(fixture_grid(layout)) if search.options.move_fixture else [layout.T_world_fixture]
    now, bare = site_of(layout), layout
    if search.options.move_camera:
        kept = {n: b for n, b in layout.obstacles.items() if n not in search.fellows.camera}
        bare = replace(layout, obstacles=kept)
    fellows = Fellows((), search.fellows.fixture)
    keep = search.options.keep_free_mm
    together = [meetings(m) for m in members]
    found: list[FixtureScore] = []
    for k, T in enumerate(poses):
        if k % 100 == 0:
            search.progress("fixture poses", k, len(poses))
        # a camera that moves has its picture looked at later, with each fixture
        why = why_not_here(
            placed_at(bare, replace(now, T_world_fixture=T), fellows),
            fellows,
            None if keep is None else np.array(keep),
            look=not search.options.move_camera,
        )
        if why is not None and k > 0:
            continue
        shares = []
        for m, T_meet in zip(members, together, strict=True):
            met = met_grips(layout, T, T_meet)
            shares.append(hand_off_shares(m, met[:, : m.base_n] | met[:, m.base_n :]))
        found.append(FixtureScore(T, tuple(s[0] for s in shares), tuple(s[1] for s in shares)))
    search.tried_n += len(poses)
    at = layout.T_world_fixture[:3, 3]

    def away_mm(score: FixtureScore) -> float:
        return round(float(np.linalg.norm(score.T_world_fixture[:3, 3] - at)), 3)

    return sorted(found, key=lambda f: (-round(f.value, 3), away_mm(f)))


def find_sites(
    parts: Sequence[PreparedPart],
    layout: CellLayout,
    options: SiteOptions | None = None,
    progress: Progress | None = None,
) -> tuple[SiteScore, ...]:
    """Return sites of camera and fixed gripper for a family of parts, all checked, best first.

    The present site is among them. Three stages: a grid by the joints alone; its best with
    collisions, sights, picks and hand-offs; small steps about the best of these. All work is
    counted, so the same cell and parts give the same sites.

    Parameters
    ----------
    parts : of `prepare_part` in this layout
    layout : arm, table and overhead camera stay; the camera keeps its distance from the station
    progress : called with what is being done, steps done and steps in all

    Raises
    ------
    ValueError : no part
    """
    return search_sites(survey(parts, layout, options, progress))


def search_sites(search: Survey) -> tuple[SiteScore, ...]:
    """Run the stages of `find_sites`."""
    options, now = search.options, site_of(search.layout)
    by_joints = cameras_by_joints(search)
    cameras = _unlike([s.site for s in by_joints], options.checked_cameras)
    fixtures = fixtures_by_joints(search)
    if options.joints_only:
        return tuple(_joined(search, by_joints, fixtures))
    few = _unlike_poses([f.T_world_fixture for f in fixtures], options.checked_fixtures)

    best = search.check(now)
    for k, camera in enumerate(cameras):
        search.progress("camera sites checked", k, len(cameras))
        for T in [search.layout.T_world_fixture, *few]:
            site = replace(camera, T_world_fixture=T if search.layout.fixture else None)
            if search.forbidden(site) is None:
                best = _better(best, search.check(site))
                break
    ranked = _unlike([s.site for s in _ranked(search)], FIXTURE_ROUNDS)
    for k, camera in enumerate(ranked):
        for i, T in enumerate(few):
            search.progress("fixture poses checked", k * len(few) + i, len(few) * len(ranked))
            site = replace(camera, T_world_fixture=T)
            if search.forbidden(site) is None:
                best = _better(best, search.check(site))
    for turn in range(options.local_steps):
        best = _step_about(search, best, STEP_MM / 2**turn, STEP_DEG / 2**turn, turn)
    return tuple(_ranked(search))


def _joined(
    search: Survey, cameras: Sequence[SiteScore], fixtures: Sequence[FixtureScore]
) -> list[SiteScore]:
    """Return camera sites, each with the best fixture pose that goes with it, by the joints alone.

    The present site is among them.
    """
    now = site_of(search.layout)
    kept = _unlike([s.site for s in cameras], search.options.checked_cameras)
    wanted = [now, *[site for site in kept if site_key(site) != site_key(now)]]
    by_key = {site_key(s.site): s for s in cameras}
    found: list[SiteScore] = []
    for k, site in enumerate(wanted):
        score = by_key[site_key(site)]
        if not fixtures:
            found.append(score)
            continue
        if k == 0:
            found.append(_with_fixture(score, next(f for f in fixtures if _stands(f, now))))
            found[0] = replace(found[0], forbidden=search.forbidden(now))
        for fixture in fixtures[:PAIRED_N]:
            pair = replace(site, T_world_fixture=fixture.T_world_fixture)
            if site_key(pair) != site_key(now) and search.forbidden(pair) is None:
                found.append(_with_fixture(replace(score, forbidden=None), fixture))
                break
    return sorted(found, key=lambda s: (s.forbidden is not None, -s.value))


def _stands(fixture: FixtureScore, site: Site) -> bool:
    return site.T_world_fixture is not None and bool(
        np.allclose(fixture.T_world_fixture, site.T_world_fixture)
    )


def _with_fixture(score: SiteScore, fixture: FixtureScore) -> SiteScore:
    parts = tuple(
        replace(p, partners_share=a, hand_offs_share=b)
        for p, a, b in zip(score.parts, fixture.partners, fixture.joined, strict=True)
    )
    site = replace(score.site, T_world_fixture=fixture.T_world_fixture)
    return replace(score, site=site, parts=parts, value=value_of(parts))


def _ranked(search: Survey) -> list[SiteScore]:
    """Return all checked sites, best first; a stable sort keeps the present one before equals."""
    return sorted(search.checked.values(), key=lambda s: (s.forbidden is not None, -s.value))


def _step_about(
    search: Survey, best: SiteScore, step_mm: float, step_deg: float, turn: int
) -> SiteScore:
    options = search.options
    steps = list(camera_steps(best.site, step_mm, step_deg)) if options.move_camera else []
    if options.move_fixture:
        steps += list(fixture_steps(best.site, step_mm, step_deg))
    start = best
    for k, site in enumerate(steps):
        search.progress(f"small steps, round {turn + 1}", k, len(steps))
        if search.forbidden(site) is None:
            best = _better(best, search.check(site))
    if best is not start and best.value > start.value + BETTER:
        # once more the same way, as far as it pays
        while True:
            onward = _onward(start.site, best.site)
            if onward is None or search.forbidden(onward) is not None:
                break
            further = search.check(onward)
            if further.value <= best.value + BETTER:
                break
            start, best = best, further
    return best


def _onward(before: Site, after: Site) -> Site | None:
    """Return the site one more equal shift along; None where it was a turn."""
    shift = after.station_mm - before.station_mm
    if np.linalg.norm(shift) > 1e-6:
        return replace(after, station_mm=after.station_mm + shift)
    if before.T_world_fixture is not None and after.T_world_fixture is not None:
        offset = after.T_world_fixture[:3, 3] - before.T_world_fixture[:3, 3]
        if np.linalg.norm(offset) > 1e-6:
            T = after.T_world_fixture.copy()
            T[:3, 3] += offset
            return replace(after, T_world_fixture=T)
    return None


def _better(best: SiteScore, other: SiteScore) -> SiteScore:
    if other.forbidden is not None:
        return best
    return other if best.forbidden is not None or other.value > best.value + BETTER else best


def _by_joints(member: FamilyMember, shown: float, views_share: float) -> PartScore:
    nan = float("nan")
    return PartScore(
        member.name, member.showable, shown, shown, shown, views_share, 1.0, 1.0, 1.0, nan, nan
    )


def _without_fixture(layout: CellLayout, fellows: Fellows) -> CellLayout:
    kept = {n: b for n, b in layout.obstacles.items() if n not in fellows.fixture}
    return replace(layout, fixture=None, obstacles=kept)


def _far_mm(layout: CellLayout, a: Site, b: Site) -> float:
    """Return how far station and camera stand from another site's."""
    far = standoff_mm(layout)
    apart = np.linalg.norm(a.station_mm - b.station_mm)
    return round(float(apart + far * np.linalg.norm(a.towards - b.towards)), 3)


def _unlike(sites: Sequence[Site], count: int) -> list[Site]:
    """Return the first sites that are not near to one before them."""
    kept: list[Site] = []
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


def _unlike_poses(poses: Sequence[FloatArray], count: int) -> list[FloatArray]:
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


def site_key(site: Site) -> tuple[int, ...]:
    """Return whole numbers that are the same for the same site and for no other."""
    values = [*site.station_mm * 100.0, *site.towards * 1e5]
    if site.T_world_fixture is not None:
        values += [
            *site.T_world_fixture[:3, 3] * 100.0,
            *site.T_world_fixture[:3, :2].ravel() * 1e5,
        ]
    return tuple(int(v) for v in np.rint(values))
