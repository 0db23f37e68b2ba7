"""A pose fitted to the grey levels of a cluster under lamps, beside its other parts.

Inner edges are visible here, and so is the border between two parts. Hidden parts of a pose are not
required, and areas explained by another part do not count against it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import cv2
import numpy as np

from controller.arrays import BoolArray, FloatArray, Grey, IntArray
from controller.imaging import Camera, inverse_pose, transform

from ...fitting import (
    NEAR_PX,
    EdgeFit,
    EdgeModel,
    Evidence,
    GreyMeasure,
    ImageEdges,
    Shading,
    are_highlights,
    asked_of_each_lamp,
    grey_evidence,
    is_predicted,
    shading_fits,
    shown_edges,
)
from ...library import Candidate
from ...partial import BURIED_CELLS, CELL_PX, Depths, leaving_depths, lines_in_both
from ..cutout import part_depth_mm
from ..scores import FRONT, beyond_chance, probability

HIDDEN_MM = 0.4  # distance by which something nearer the eye hides an edge
BESIDE_PX = 1  # outside its mask strong edges still are the part's
RIM_PX = 2  # width of the rim whose grey levels blur with what lies beside it
# Distance outside an outline where another part replaces its border with the table.
OUTSIDE_PX = 2.5
# positions on a shared stretch of a line of sight where both parts are tested
PROBED = (0.2, 0.5, 0.8)
NEXT_PX = 12.0  # distance between two shadows beyond which one part does not affect the other
WITHIN_PX = 2.0  # distance inside an outline where the surface beside it is probed
ENDS = 0.7  # least share of the visible outline across curved surfaces, from twelve right fits
# in pictures developed with eleven have 0.78 and more, of two wrong ones along a screw none 0.63


class LitCluster:
    """A region of a picture under lamps that may hold several parts.

    Parameters
    ----------
    pictures : (height, width) grey, of the scene; of several the first is the brightest of the
        others, which are judged together
    box_px : x0, y0, x1, y1 of the crop, wide enough for all of its parts
    mask : (h, w) mask of the crop, what was cut out
    camera : overhead, calibrated
    """

    def __init__(
        self,
        pictures: Sequence[Grey],
        box_px: tuple[int, int, int, int],
        mask: BoolArray,
        camera: Camera,
    ) -> None:
        self.box_px, self.mask, self.camera = box_px, mask, camera
        x0, y0, x1, y1 = box_px
        self.crops = [np.ascontiguousarray(one[y0:y1, x0:x1]) for one in pictures]
        first, *others = self.crops
        self.telling = others or self.crops
        self.grey = GreyMeasure(first, (x0, y0), is_lit=True, others=others)
        self.image_edges = ImageEdges.of(self.grey, np.ones(mask.shape, dtype=np.bool_))

    def mm_per_px(self, x_mm: float, y_mm: float) -> float:
        """Return the size of a pixel on the table."""
        return self.camera.mm_per_px(np.array([x_mm, y_mm, 0.0]))

    def cell_lines(self, at: IntArray) -> FloatArray:
        """Return lines of sight (n, 3) of every `CELL_PX`-th pixel of the crop, by number (n,)."""
        y, x = np.divmod(at, -(-self.mask.shape[1] // CELL_PX))
        pixels = CELL_PX * np.column_stack([x, y]).astype(np.float64) + self.box_px[:2]
        return self.camera.sight_lines(pixels)

    def index(self, pixels: FloatArray) -> tuple[IntArray, IntArray, BoolArray]:
        """Return rows and columns (n,) of pixels (n, 2) in the crop, and which are in it."""
        height, width = self.mask.shape
        x, y = np.round(np.nan_to_num(pixels, nan=-1e6) - self.box_px[:2]).astype(np.int64).T
        within = (x >= 0) & (y >= 0) & (x < width) & (y < height)
        return np.clip(y, 0, height - 1), np.clip(x, 0, width - 1), within


@dataclass(frozen=True, eq=False)
class LitFit:
    """A candidate, fitted.

    Attributes
    ----------
    candidate, model : candidate, and the model fitted
    fit : its visible edges, hidden by others or not
    cluster : cluster it was fitted to
    leans : it was fitted with any tilt and height, as a part that lies on another
    """

    candidate: Candidate
    model: EdgeModel
    fit: EdgeFit
    cluster: LitCluster
    leans: bool = False

    @property
    def T(self) -> FloatArray:
        """Pose of the part in the world, (4, 4)."""
        return self.fit.T_world_part

    @property
    def mm_per_px(self) -> float:
        """Size of a pixel on the table about where it is."""
        return self.cluster.mm_per_px(float(self.T[0, 3]), float(self.T[1, 3]))

    @property
    def is_curved(self) -> bool:
        """True if some of its surfaces are curved."""
        return bool(np.isfinite(self.model.straight[:, 0]).any())

    @cached_property
    def depth_mm(self) -> FloatArray:
        """Depth (h, w) of the crop from the camera to the part; inf beside it."""
        cluster = self.cluster
        return part_depth_mm(self.model, self.fit, cluster.camera, cluster.box_px)

    @cached_property
    def shadow(self) -> BoolArray:
        """Mask (h, w) of where the part is seen, if nothing hides it."""
        return np.asarray(np.isfinite(self.depth_mm))

    def is_outside(self, pixels: FloatArray) -> BoolArray:
        """Return a mask (n,) of the picture points (n, 2) beside the part, not in a hole."""
        rims, _ = cv2.findContours(
            self.shadow.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )
        filled = cv2.drawContours(np.zeros(self.shadow.shape, np.uint8), rims, -1, 1, cv2.FILLED)
        y, x, is_in = self.cluster.index(pixels)
        return np.asarray(~is_in | (filled[y, x] == 0))

    @cached_property
    def extent(self) -> tuple[int, int, int, int]:
        """First and last column, first and last row of the crop where the part is seen."""
        return _extent(self.shadow)

    def is_near(self, other: "LitFit", area: BoolArray) -> bool:
        """Return True if another part may change the view of this one, or of an area (h, w)."""
        theirs = other.extent
        reach_px = NEXT_PX + self.fit.edges.step_mm / self.mm_per_px
        reach_px += other.fit.edges.step_mm / self.mm_per_px
        return any(_meet(mine, theirs, reach_px) for mine in (self.extent, _extent(area)))

    def is_above(self, other: "LitFit") -> bool:
        """Return True if it lies in front of another part by more than chance."""
        nearer = other.shadow & (self.depth_mm < other.depth_mm - HIDDEN_MM)
        return int(nearer.sum()) > BURIED_CELLS * CELL_PX**2

    def is_hidden(self, others: Sequence["LitFit"]) -> BoolArray:
        """Return a mask (n,) of its edges behind other parts."""
        edges = self.fit.edges
        eye = self.cluster.camera.position_mm
        axis = self.cluster.camera.T_world_cam[:3, 2]
        own = (edges.points_mm - eye) @ axis
        y, x, within = self.cluster.index(edges.pixels)
        answer = np.zeros(len(own), dtype=np.bool_)
        for other in others:
            answer |= within & (other.depth_mm[y, x] < own - HIDDEN_MM)
        return answer

    def visible_mask(self, others: Sequence["LitFit"]) -> BoolArray:
        """Return the mask (h, w) of the part where no other lies in front of it."""
        seen = self.shadow
        for other in others:
            seen = seen & ~(other.depth_mm < self.depth_mm)
        return np.asarray(seen)

    def is_beside(self, others: Sequence["LitFit"]) -> BoolArray:
        """Return a mask (n,) of its outline's edges with another part just outside."""
        edges = self.fit.edges
        y, x, within = self.cluster.index(edges.pixels + OUTSIDE_PX * edges.normals)
        answer = np.zeros(len(edges.pixels), dtype=np.bool_)
        for other in others:
            answer |= within & other.shadow[y, x]
        return answer & edges.on_outline

    def free_share(self, others: Sequence["LitFit"]) -> float:
        """Return the share of its outline without another part in front or beside."""
        on = self.fit.edges.on_outline
        if not on.any():
            return 0.0
        return float((~(self.is_hidden(others) | self.is_beside(others)))[on].mean())

    def seen_fit(self, others: Sequence["LitFit"]) -> EdgeFit:
        """Return the fit with only those edges that no other part hides."""
        return self.fit.at(~self.is_hidden(others))

    def has_ends(self, seen: EdgeFit, shown: tuple[FloatArray, float] | None = None) -> bool:
        """Return True if the picture shows those edges that do not run along a curved surface.

        Edges along a cylinder are present for a shorter or longer one as well, at any place along
        it, and so are the streaks on it: its ends and steps identify it.

        Parameters
        ----------
        seen : `seen_fit` beside other parts
        shown : `shown_edges` of it; None where the strongest gradient alone is asked
        """
        edges, camera = seen.edges, self.cluster.camera
        beside = edges.pixels - np.where(edges.on_outline, WITHIN_PX, 0.0)[:, None] * edges.normals
        along = are_highlights(self.model, self.T, camera, beside, edges.normals)
        weight = np.where(along, 0.0, seen.gaps.weight)
        is_there = seen.off_px < NEAR_PX
        total = float(weight.sum())
        share = float((weight * is_there).sum()) / max(total, 1e-9)
        if shown is not None:
            by_lamp = float((weight * (shown[0] < NEAR_PX)).sum()) / max(total, 1e-9)
            share = max(share, beyond_chance(by_lamp, shown[1]))
        return share > ENDS

    def evidence(self, others: Sequence["LitFit"], area: BoolArray | None = None) -> Evidence:
        """Return the evidence of the picture for this part beside others.

        Parameters
        ----------
        others : the parts beside it
        area : (h, w) area of the crop that is asked about, less what others hide; None for where
            the part itself is seen
        """
        cluster = self.cluster
        free = self.seen_fit(others)
        edges = free.edges
        seen = self.visible_mask(others)
        if area is not None:
            seen = seen | area
            for other in others:
                seen &= ~(other.shadow & ~(self.depth_mm < other.depth_mm))
        wide = np.ones((2 * BESIDE_PX + 1,) * 2, np.uint8)
        about = cv2.dilate(seen.astype(np.uint8), wide) > 0
        inside = cv2.erode(seen.astype(np.uint8), np.ones((2 * RIM_PX + 1,) * 2, np.uint8)) > 0
        picture_edges = ImageEdges.of(cluster.grey, np.asarray(about))
        if others:
            own = is_predicted(picture_edges.points_px, edges, edges.step_mm / self.mm_per_px)
            theirs = np.zeros(len(own), dtype=np.bool_)
            for other in others:
                step_px = other.fit.edges.step_mm / self.mm_per_px
                theirs |= is_predicted(picture_edges.points_px, other.fit.edges, step_px)
            picture_edges = picture_edges.at(own | ~theirs)
        shine, shown = None, None
        if cluster.grey.is_joint:
            beside = [other.fit.edges for other in others]
            shown = shown_edges(edges, cluster.grey, self.mm_per_px, beside)
        if self.is_curved and self.has_ends(free, shown):
            shine = partial(are_highlights, self.model, self.T, cluster.camera)
        shadings = shading_fits(
            self.model,
            self.fit.T_world_part,
            cluster.camera,
            cluster.telling,
            cluster.box_px[:2],
            np.asarray(inside),
        )
        found = grey_evidence(
            edges,
            self.fit.sigma_px,
            self.mm_per_px,
            (cluster.grey,),
            picture_edges,
            Shading.of_all(shadings),
            shine,
        )
        if shown is None:
            return found
        # each of the two names a part by itself
        each = asked_of_each_lamp(found, edges, shown)
        return max((found, each), key=lambda one: probability(one, FRONT))

    @cached_property
    def evidence_alone(self) -> Evidence:
        """Evidence of the picture for it, with nothing known beside it."""
        return self.evidence(())

    @cached_property
    def explains(self) -> BoolArray:
        """Mask (m,) of the cluster's strong edges that it predicts."""
        edges = self.fit.edges
        step_px = edges.step_mm / self.mm_per_px
        return is_predicted(self.cluster.image_edges.points_px, edges, step_px)

    @cached_property
    def depths(self) -> Depths:
        """Depths where the lines of sight of `LitCluster.cell_lines` enter and leave the part."""
        enter = self.depth_mm[::CELL_PX, ::CELL_PX].ravel()
        leave = np.full(enter.shape, np.nan)
        hit = np.flatnonzero(np.isfinite(enter))
        lines, eye = self.cluster.cell_lines(hit), self.cluster.camera.position_mm
        leave[hit] = leaving_depths(self.model, self.T, eye, lines, enter[hit])
        return enter, leave

    def holds(self, points_mm: FloatArray) -> BoolArray:
        """Return a mask (n,) of the points (n, 3) of the world inside the part."""
        T = inverse_pose(self.T)
        up = T[:3, :3] @ np.array([0.0, 0.0, 1.0])
        triangle, _ = self.model.caster.first_hit(transform(T, points_mm), up)
        return np.asarray((triangle >= 0) & (self.model.normals[triangle] @ up > 0))

    @cached_property
    def span_mm(self) -> tuple[float, float]:
        """Its lowest and its highest point above the table."""
        z = transform(self.fit.T_world_part, self.model.start_mm)[:, 2]
        return float(z.min()), float(z.max())


def _extent(seen: BoolArray) -> tuple[int, int, int, int]:
    columns, rows = np.flatnonzero(seen.any(axis=0)), np.flatnonzero(seen.any(axis=1))
    if len(columns) == 0:
        return 0, -1, 0, -1
    return int(columns[0]), int(columns[-1]), int(rows[0]), int(rows[-1])


def _meet(a: tuple[int, ...], b: tuple[int, ...], reach_px: float) -> bool:
    across = max(a[0], b[0]) - min(a[1], b[1])
    along = max(a[2], b[2]) - min(a[3], b[3])
    return max(across, along) <= reach_px


def are_in_one_place(a: LitFit, b: LitFit) -> bool:
    """Return True if two parts overlap in space."""
    at, chance = lines_in_both(a.depths, b.depths)
    if len(at) <= chance:
        return False
    # between where a line enters a part and leaves it there may be hollows
    (enter_a, leave_a), (enter_b, leave_b) = a.depths, b.depths
    first = np.maximum(enter_a[at], enter_b[at])
    shared = np.minimum(leave_a[at], leave_b[at]) - first
    lines, eye = a.cluster.cell_lines(at), a.cluster.camera.position_mm
    is_buried = np.zeros(len(at), dtype=np.bool_)
    for share in PROBED:
        points = eye + (first + share * shared)[:, None] * lines
        is_buried |= a.holds(points) & b.holds(points)
    return int(is_buried.sum()) > chance
