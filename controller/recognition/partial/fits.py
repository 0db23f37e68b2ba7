"""A pose fitted to the visible part of its outline in a cluster, and the evidence.

A point of the predicted outline is found, or covered: the cluster goes on outside it, or the
picture ends. Otherwise the picture contradicts it. Covered stretches end where outlines meet: there
the cluster's outline turns inwards. One that ends elsewhere is caused by a known neighbour flush
with it, or else it is the outline of another part, longer or without that hole.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import BoolArray, FloatArray
from controller.cad.graph import components
from controller.imaging import meet_part

from ..fitting import (
    FAR_PX,
    FINE_REACH_MM,
    NEAR_PX,
    EdgeFit,
    EdgeModel,
    FitOptions,
    ModelEdgePoints,
    at_rest_in,
    fit_edges,
    is_predicted,
)
from ..library import Candidate, Library, pose_on_table
from .cluster import CELL_PX, Cluster
from .depths import Depths, leaving_depths

COVERED_PX = 2.0  # distance outside an outline where the cluster goes on if something covers it
# distance from the end of a covered stretch: a narrow wedge of light fills up with blur
MEETING_MM = 5.0
SHORT_MM = 2.5  # covered stretches this short are touched at a point
FIRST_MM = 5.0  # largest offset of a candidate, a tall part's slack aside
# Where what covers a part is unknown, it may be more of the part itself: a boss that is taller than
# the known part's. So the fit has to be as good as that of a part alone, and the cover no strip.
SURE_AGREEMENT, SURE_PX = 0.98, 0.35
THICK_MM, THICK_SHARE = 6.0, 0.5  # of what covers it, and of the stretch that is so covered
COARSE_SAMPLES, SAMPLES = 250, 600
# Score of a fit with nine tenths of its points within NEAR_PX; 93 accepted fits had 0.946.
COARSE_SHARE = 0.73


@dataclass(frozen=True, eq=False)
class PartialFit:
    """A candidate, fitted.

    Attributes
    ----------
    candidate, model : candidate, and the model fitted
    fit : its whole predicted outline, covered or not
    is_found, is_covered : (n,) masks of the predicted points; neither is contradicted
    is_beyond : (n,) mask of the covered ones without any data
    cluster : cluster it was fitted to
    mm_per_px : at the part
    """

    candidate: Candidate
    model: EdgeModel
    fit: EdgeFit
    is_found: BoolArray
    is_covered: BoolArray
    is_beyond: BoolArray
    cluster: Cluster
    mm_per_px: float

    @cached_property
    def is_unmet(self) -> BoolArray:
        """Mask (n,) of the covered points in stretches that end without a meeting of outlines."""
        covered = self.is_covered & ~self.is_beyond
        return covered & ~_ends_at_meetings(
            self.fit.edges, covered, self.is_beyond, self.cluster, self.mm_per_px
        )

    @cached_property
    def explains(self) -> BoolArray:
        """Mask (m,) of the cluster's outline points that it predicts."""
        edges = self.fit.edges
        return is_predicted(self.cluster.points_px, edges, edges.step_mm / self.mm_per_px)

    @property
    def free_share(self) -> float:
        """Share of the predicted outline that nothing covers."""
        return float(1.0 - self.is_covered.mean())

    @property
    def agreement(self) -> float:
        """Share of the uncovered outline that is found."""
        free = int((~self.is_covered).sum())
        return float(self.is_found.sum()) / free if free else 0.0

    @property
    def misfit_px(self) -> float:
        """Root mean square distance of the free outline; a missing point counts `FAR_PX`."""
        off = np.where(self.is_found, self.fit.off_px, FAR_PX)[~self.is_covered]
        return float(np.sqrt(np.mean(off**2))) if len(off) else FAR_PX

    @property
    def rank(self) -> float:
        """Order in which fits are tried: by the points they explain, and how well."""
        free = int((~self.is_covered | self.is_unmet).sum())
        sure = float(self.is_found.sum()) / max(free, 1)
        return float(self.explains.sum()) * sure / (0.3 + self.misfit_px)

    @cached_property
    def free_fit(self) -> EdgeFit:
        """The fit to the uncovered edges alone."""
        return self.fit.at(~self.is_covered)

    @cached_property
    def depths(self) -> Depths:
        """Depths (n,) where the lines of sight enter and leave the part, nan where they miss it."""
        lines, _, _ = self.cluster.cells
        x0, y0, _, _ = self.cluster.region.box_px
        low = (self.fit.edges.pixels.min(axis=0) - [x0, y0]) / CELL_PX - 1
        high = (self.fit.edges.pixels.max(axis=0) - [x0, y0]) / CELL_PX + 1
        cell = self.cluster.cells[1][:, ::-1]
        asked = np.flatnonzero(((cell >= low) & (cell <= high)).all(axis=1))
        enter, leave = np.full(len(lines), np.nan), np.full(len(lines), np.nan)
        T, eye = self.fit.T_world_part, self.cluster.camera.position_mm
        triangle, far = meet_part(self.model.caster, T, eye, lines[asked])
        hit = asked[triangle >= 0]
        enter[hit] = far[triangle >= 0]
        leave[hit] = leaving_depths(self.model, T, eye, lines[hit], enter[hit])
        return enter, leave

    def lacks_cover(self, others: Sequence["PartialFit"]) -> bool:
        """Return True if its hidden edges have no part or object that could cover them.

        Parameters
        ----------
        others : the other parts that are there
        """
        edges, cluster = self.fit.edges, self.cluster
        outside = edges.pixels + COVERED_PX * edges.normals
        by_others = np.zeros(len(self.shadow), dtype=np.bool_)
        for other in others:
            by_others |= other.shadow
        unknown = self.is_covered & ~cluster.is_beyond(edges.pixels)
        unknown &= ~cluster.looks_up(by_others, outside)
        if unknown.sum() * edges.step_mm < SHORT_MM:
            return False
        if (unknown & self.is_unmet).sum() * edges.step_mm >= SHORT_MM:
            return True
        if self.agreement < SURE_AGREEMENT or self.misfit_px > SURE_PX:
            return True
        thick = cluster.thick(cluster.cells[2] & ~by_others & ~self.shadow, THICK_MM)
        return bool(cluster.looks_up(thick, outside[unknown]).mean() < THICK_SHARE)

    @cached_property
    def shadow(self) -> BoolArray:
        """Mask (n,) of the cluster's lines of sight that meet the part."""
        return np.isfinite(self.depths[0])


def fit_partial(candidate: Candidate, cluster: Cluster, library: Library) -> PartialFit | None:
    """Return a candidate fitted to a cluster; None where its uncovered edges do not agree.

    Parameters
    ----------
    candidate : candidate at about the right pose
    cluster : cluster as seen
    library : library of the candidate
    """
    model = library.model(candidate.part)
    pose = library.entries[candidate.part].pose(candidate.pose)
    T = pose_on_table(model, pose, candidate.x_mm, candidate.y_mm, candidate.theta_rad)
    mm_per_px = cluster.camera.mm_per_px(np.array([candidate.x_mm, candidate.y_mm, 0.0]))
    reach_px = (FIRST_MM + 0.5 * candidate.slack_mm) / mm_per_px
    coarse = FitOptions(reach_px=(reach_px,), steps=3, most=COARSE_SAMPLES)
    fit = fit_edges(model, T, cluster.camera, cluster.measure, coarse)
    if fit is None or _nearness(fit, cluster) < COARSE_SHARE:
        return None
    fine = FitOptions(
        reach_px=tuple(mm / mm_per_px for mm in FINE_REACH_MM),
        steps=3,
        prior=at_rest_in(pose, is_lit=False),
        most=SAMPLES,
    )
    fit = fit_edges(model, fit.T_world_part, cluster.camera, cluster.measure, fine)
    if fit is None:
        return None
    found = fit.off_px < NEAR_PX
    covered, beyond = _covered(fit.edges, cluster)
    beyond &= ~found
    covered &= ~found & ~beyond
    return PartialFit(candidate, model, fit, found, covered | beyond, beyond, cluster, mm_per_px)


def _covered(edges: ModelEdgePoints, cluster: Cluster) -> tuple[BoolArray, BoolArray]:
    """Return masks of the edges outside which the cluster goes on, and of those without data."""
    outside = cluster.is_inside(edges.pixels + COVERED_PX * edges.normals)
    return outside, cluster.is_beyond(edges.pixels)


def _nearness(fit: EdgeFit, cluster: Cluster) -> float:
    """Return the share of free predicted edges found about in place."""
    near = fit.closeness
    covered, beyond = _covered(fit.edges, cluster)
    free = ~(covered | beyond) | (fit.off_px < FAR_PX)
    return float(near[free].mean()) if free.mean() > 0.2 else 0.0


def _ends_at_meetings(
    edges: ModelEdgePoints,
    covered: BoolArray,
    beyond: BoolArray,
    cluster: Cluster,
    mm_per_px: float,
) -> BoolArray:
    """Return a mask (n,) of covered edges in a stretch that ends where outlines meet."""
    answer = covered.copy()
    at = np.flatnonzero(covered)
    if len(at) == 0:
        return answer
    step_px = edges.step_mm / mm_per_px
    link_px = 2.2 * step_px + 1.0
    tree = cKDTree(edges.pixels[at])
    pairs = tree.query_pairs(link_px, output_type="ndarray")
    stretch = components(len(at), pairs[:, 0], pairs[:, 1])
    near_free = _are_near(edges.pixels[at], edges.pixels[~(covered | beyond)], link_px)
    near_rim = _are_near(edges.pixels[at], edges.pixels[beyond], link_px)
    # an end is a sample or two off the place itself
    meets = _are_near(edges.pixels[at], cluster.meetings_px, MEETING_MM / mm_per_px + link_px)
    for k in range(int(stretch.max()) + 1):
        mine = stretch == k
        if mine.sum() * edges.step_mm < SHORT_MM:
            continue
        ends = mine & near_free
        if not ((ends.any() or (mine & near_rim).any()) and meets[ends].all()):
            answer[at[mine]] = False
    return answer


def _are_near(points: FloatArray, others: FloatArray, within_px: float) -> BoolArray:
    """Return a mask (n,) of the points (n, 2) with one of some others (m, 2) near them."""
    if len(others) == 0:
        return np.zeros(len(points), dtype=np.bool_)
    tree = cKDTree(others, balanced_tree=False, compact_nodes=False)
    far, _ = tree.query(points, distance_upper_bound=within_px)
    return np.asarray(far < within_px)
