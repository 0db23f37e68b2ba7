"""Data on one part in one cell that the planner's packages share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from controller.arrays import BoolArray, FloatArray, Int32Array
from controller.cad import Solid, StablePose, SurfaceSamples
from controller.imaging import inverse_pose

from ..geometry import Box, PartShape, PlacedShape
from .grasp import Grasp, GraspRules
from .visibility import BoreOpenings, Counted, Directions, VisibilityTable


@dataclass(frozen=True, slots=True, eq=False)
class HandOff:
    """The meeting of an arm grasp with the receiver of the part: the fixed gripper, or the table.

    Attributes
    ----------
    q : (6,) joints at which the part changes hold
    entry : (k, 6) path from the far end of the straight path in, up to `q`
    retreat : (k, 6) path from `q` to a pose where the empty gripper is clear
    """

    q: FloatArray
    entry: FloatArray
    retreat: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Rest:
    """A pose in which the part may be set down on the table: stable pose, T_world_part (4, 4)."""

    pose_index: int
    T_world_part: FloatArray


def of_faces(value: float | tuple[float, ...], face_ids: Int32Array) -> FloatArray:
    """Return a number of every face, or by face id, at surface points (n,) on faces."""
    by_face = np.asarray(value, dtype=np.float64)
    return by_face[face_ids] if by_face.ndim else np.full(len(face_ids), by_face)


@dataclass(frozen=True, slots=True)
class PlanOptions:
    """Aims of the planner."""

    max_incidence_deg: float = 70.0  # a surface at a flatter angle than this shows too little
    # pixels per millimetre along the surface, foreshortening included, that a view must give: of
    # every face, or by its id
    min_px_per_mm: float | tuple[float, ...] = 1.0
    direction_count: int = 90  # directions of the even sphere, beside square ones
    arm_grasps_per_pose: int = 8
    arm_grasps_round: int = 16
    fixed_grasps: int = 16
    # share of the surface that a view of usual length must add, and what takes longer so much more;
    # 0 shows all that can be
    least_gain: float = 0.0
    face_share: float = 0.5  # share of each face and bore that a PASS needs
    # the overhead camera's pictures of the part where it lies are views, where they resolve enough
    table_views: bool = True
    # the first solution of the search is taken, with its gap
    is_coarse: bool = False
    # the cell takes jaws that stop further off than this for another grasp (recipe's grasp section)
    opening_tolerance_mm: float = 2.0
    square_share: float = 0.5  # share of a face that a view must show to count as its square view
    rules: GraspRules = field(default_factory=GraspRules)

    def coarse(self) -> PlanOptions:
        """Return the same aims with few candidates, for a quick first plan."""
        return replace(
            self,
            is_coarse=True,
            direction_count=40,
            arm_grasps_per_pose=3,
            arm_grasps_round=6,
            fixed_grasps=6,
            rules=self.rules.coarse(),
        )


@dataclass(frozen=True, slots=True)
class FaceToShowAgain:
    """A face with too little compared from a grasp of the arm, though it was in sight.

    Attributes
    ----------
    grasp : its id
    face : id
    """

    grasp: str
    face: int


@dataclass(frozen=True, slots=True, eq=False)
class PreparedPart:
    """All data on one part in one cell that do not depend on its pose on the table.

    Attributes
    ----------
    samples : n, of the surface, that views are chosen by
    shape : the part's triangles, to be asked what they touch
    arm_grasps : each base grasp, then each once more with the arm gripper turned over, then
        measured ones
    visibility_table : directions, and what the bare part shows in each
    shown : per arm grasp (v, n), what of it gripper and arm leave in sight
    openings : elements (e) of its bores: sectors of rims beside which light is to be shown, and
        floors
    shown_open : per arm grasp (v, e), those that part and gripper leave in sight
    view_q : per arm grasp, direction -> (k, 6) collision-free configurations
    hand_offs : per grasp of the fixed gripper, arm grasp -> how they meet
    covered : (g, n) samples some reachable view of an arm grasp shows
    home_q : (g, 6) one configuration of each arm grasp, in the midst of its views
    counted : points that count the coverage of plans; None for the samples they are chosen by
    rests, set_downs : poses for setting the part down, and per rest and arm grasp the motion; empty
        if no plan has needed them
    """

    solid: Solid
    samples: SurfaceSamples
    options: PlanOptions
    shape: PartShape
    poses: tuple[StablePose, ...]
    arm_grasps: tuple[Grasp, ...]
    fixed_grasps: tuple[Grasp, ...]
    visibility_table: VisibilityTable
    shown: tuple[BoolArray, ...]
    openings: BoreOpenings
    shown_open: tuple[BoolArray, ...]
    view_q: tuple[Mapping[int, FloatArray], ...]
    hand_offs: tuple[Mapping[int, HandOff], ...]
    covered: BoolArray
    home_q: FloatArray
    rests: tuple[Rest, ...] = ()
    set_downs: tuple[Mapping[int, HandOff], ...] = ()
    counted: Counted | None = None

    @property
    def weights(self) -> FloatArray:
        """Each sample's share of the surface (n,)."""
        areas = self.samples.areas_mm2
        return np.asarray(areas / areas.sum())

    @property
    def counted_samples(self) -> SurfaceSamples:
        """The points (m) that count coverage, and that plans report."""
        return self.samples if self.counted is None else self.counted.samples

    @property
    def directions(self) -> Directions:
        """The directions (v) from which the part may be looked at."""
        return self.visibility_table.directions

    @property
    def visible(self) -> BoolArray:
        """The samples that the bare part shows in each direction (v, n)."""
        return self.visibility_table.visible

    @property
    def part_box(self) -> Box:
        """The box round the part, along the axes of the CAD frame."""
        return self.shape.box

    def carried(self, grasp: Grasp) -> PlacedShape:
        """Return the part in the TCP frame of the arm gripper that holds it."""
        return PlacedShape(self.shape, inverse_pose(grasp.T_part_tcp))

    def carried_box(self, grasp: Grasp) -> Box:
        """Return the part as a box in the TCP frame of the arm gripper that holds it."""
        return self.part_box.placed(inverse_pose(grasp.T_part_tcp))
