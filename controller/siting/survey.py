"""One search over sites: the cell, the family, and the sites checked so far."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from controller.planning.model import CellLayout, PreparedPart

from ._family import FamilyMember, family_member
from .checks.checked import score_site
from .checks.keepouts import why_not_here
from .score import SiteOptions, SiteScore
from .site import CellSite, Fellows, fellows_of, placed_at

Progress = Callable[[str, int, int], None]  # name of the step, steps done, steps in all


def _quiet(what: str, done: int, total: int) -> None:
    return None


@dataclass(slots=True, eq=False)
class Survey:
    """One search: the cell, the family, and every site checked so far.

    It is one object because all stages share the members and the sites checked so far.
    """

    layout: CellLayout
    members: tuple[FamilyMember, ...]
    options: SiteOptions
    fellows: Fellows
    progress: Progress = _quiet
    checked: dict[tuple[int, ...], SiteScore] = field(default_factory=dict)
    tried_count: int = 0

    def forbidden(self, site: CellSite) -> str | None:
        """Return why a site is forbidden, None if it is allowed."""
        keep = self.options.keep_free_mm
        return why_not_here(
            placed_at(self.layout, site, self.fellows),
            self.fellows,
            None if keep is None else np.array(keep),
        )

    def check(self, site: CellSite) -> SiteScore:
        """Return the full score of a site, computed once."""
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

    Parameters
    ----------
    parts : the family the cell is laid out for, at least one
    layout : the cell as it stands
    options : extent of the search; None for the defaults
    progress : called with the name of the step, steps done and steps in all; None for no call

    Raises
    ------
    ValueError : no part
    """
    if not parts:
        raise ValueError("siting needs at least one part")
    options = options or SiteOptions()
    progressed = progress or _quiet
    members = []
    for k, part in enumerate(parts):
        progressed("parts", k, len(parts))
        members.append(
            family_member(
                part, layout, options.arm_grasps, options.fixed_grasps, options.directions
            )
        )
    return Survey(layout, tuple(members), options, fellows_of(layout), progressed)


def site_key(site: CellSite) -> tuple[int, ...]:
    """Return whole numbers that are equal for the same site and different for any other."""
    values = [*site.station_mm * 100.0, *site.towards * 1e5]
    if site.T_world_fixed_tcp is not None:
        values += [
            *site.T_world_fixed_tcp[:3, 3] * 100.0,
            *site.T_world_fixed_tcp[:3, :2].ravel() * 1e5,
        ]
    return tuple(int(v) for v in np.rint(values))
