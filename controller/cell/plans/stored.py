"""Plans, certificates and prepared parts as files of the cache: storing and checking.

`controller.cache` stores them as JSON and arrays and reads them by type alone, so that a file
cannot hold code. The content is then checked against the requirements on a plan: a file that was
planted, or damaged under a valid digest, moves no arm.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from controller.arrays import FloatArray
from controller.cache import DiskCache, given, one_of
from controller.cad import Solid, SurfaceSamples
from controller.cad.compiled import CompiledPart, solids
from controller.planning import (
    Certificate,
    GiveStep,
    Look,
    Pick,
    Plan,
    PreparedPart,
    Present,
    ReceiveStep,
    SetDown,
    Step,
)
from controller.planning.geometry import PartShape
from controller.planning.model import Counted

# To be raised when the meaning of stored plans changes.
FORMAT = 5
MAX_PREPARED_COUNT = 30  # files of some megabytes each; the oldest are deleted first
STEPS = (Pick, Present, GiveStep, ReceiveStep, SetDown, Look)
ROTATION_TOLERANCE = 1e-6
# Fields of one array, whose shape is checked; other fields are searched for such fields.
POSES = ("T_world_part", "T_part_tcp", "T_tcp_part")
VECTORS = {"q": 6, "direction_part": 3}
PATHS = (
    "motion",
    "motion_in",
    "motion_down",
    "motion_up",
    "motion_out",
    "approach",
    "retreat",
)


@dataclass(frozen=True, slots=True, eq=False)
class KeptPlan:
    """A plan from one pose on the table, or why there is none.

    Attributes
    ----------
    T_world_part : (4, 4) pose of the part
    plan : None where `reason` says why
    """

    pose_index: int
    T_world_part: FloatArray
    plan: Plan | None
    reason: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Certified:
    """The certificate of a stable pose in a cell.

    Attributes
    ----------
    arm_grasp_count, fixed_grasp_count : number of grasps that plans choose from
    """

    certificate: Certificate
    arm_grasp_count: int
    fixed_grasp_count: int


class PartCaches:
    """The caches of one part: its plans, certificates and prepared data."""

    def __init__(self, part: CompiledPart) -> None:
        self._part = part
        steps = {Step: one_of(STEPS, {Solid: solids()})}
        self.plans = DiskCache(
            KeptPlan,
            "plan",
            "a plan",
            steps,
            check=self._check_kept,
        )
        self.certificates = DiskCache(
            Certified,
            "certificate",
            "a certificate",
            steps,
            check=self._check_certified,
        )

    @cached_property
    def prepared(self) -> DiskCache[PreparedPart]:
        """The cache of the prepared part; it refers to the part, which is not stored again."""
        solid, shape = self._part.solid, PartShape.of(self._part.solid)
        return DiskCache(
            PreparedPart,
            "prepared",
            "a prepared part",
            {Solid: given(solid), PartShape: given(shape)},
            check=self._check_prepared,
            max_count=MAX_PREPARED_COUNT,
        )

    def _check_prepared(self, prepared: PreparedPart) -> None:
        check_prepared(prepared)
        counted = len(self._part.samples.points_mm)
        _require(len(prepared.counted_samples.points_mm) == counted, "other samples to count by")

    def _check_kept(self, kept: KeptPlan) -> None:
        if kept.pose_index not in {pose.index for pose in self._part.poses}:
            raise ValueError(f"the part has no pose {kept.pose_index}")
        _require(is_pose(kept.T_world_part), "T_world_part is no pose")
        self._check_outcome(kept.plan, kept.reason)

    def _check_certified(self, certified: Certified) -> None:
        certificate = certified.certificate
        if certificate.pose_index not in {pose.index for pose in self._part.poses}:
            raise ValueError(f"the part has no pose {certificate.pose_index}")
        _require(0 <= certificate.probability <= 1 + 1e-9, "a probability outside 0..1")
        _require(0 <= certificate.pickable <= 1, "a share outside 0..1")
        counts = certified.arm_grasp_count, certified.fixed_grasp_count
        _require(min(counts) >= 0, "a count below zero")
        self._check_outcome(certificate.plan, certificate.reason)

    def _check_outcome(self, plan: Plan | None, reason: str) -> None:
        _require((plan is None) == bool(reason), "a plan and a reason against it, or neither")
        if plan is not None:
            check_plan(plan, len(self._part.samples.points_mm), len(self._part.solid.faces))


def check_plan(plan: Plan, sample_count: int, face_count: int) -> None:
    """Check that a plan can belong to a part, whatever its cell.

    Parameters
    ----------
    plan : as it was read from a file
    sample_count : surface samples of the part
    face_count : CAD faces of the part

    Raises
    ------
    ValueError : it cannot; the message names the contradiction
    """
    _require(bool(plan.place), "a plan that ends nowhere")
    _require(plan.place.keys() == plan.park.keys(), "trays without a path to park, or the reverse")
    for name, place in plan.place.items():
        _require(place.tray == name, "a tray under another name")
    for share in (plan.covered_fraction, plan.covered_U, plan.reachable_fraction):
        _require(0 <= share <= 1 + 1e-9, "a share outside 0..1")
    for unseen in plan.unseen:
        _require(0 <= unseen.face_id < face_count, "a surface that is not there")
        _require(all(0 <= s < sample_count for s in unseen.samples), "no such sample")
    _check_fields(plan, sample_count, "plan")


def check_prepared(part: PreparedPart) -> None:
    """Raise ValueError if tables of a prepared part do not fit together."""
    samples = len(part.samples.points_mm)
    grasps, views = len(part.arm_grasps), len(part.directions.vectors)
    _check_samples(part.samples, len(part.solid.faces))
    if part.counted is not None:
        _check_counted(part.counted, samples, len(part.solid.faces))
    _require(part.directions.vectors.shape == (views, 3), "directions of another shape")
    _require(part.directions.square_to.shape == (views,), "directions of another number")
    for table in (part.visible, *part.shown):
        _require(table.shape == (views, samples), "views of another number of samples")
    bores = part.openings
    _require(_are_below(bores.faces, len(part.solid.faces)), "a bore on no surface")
    _require(bores.needed.shape == bores.faces.shape, "elements of another number")
    _require(_are_below(bores.element, len(bores.faces)), "no such element of a bore")
    for places in (bores.points_mm, bores.axes):
        _require(places.shape == (len(bores.element), 3), "places of another number")
    for table in part.shown_open:
        _require(table.shape == (views, len(bores.faces)), "bores of another number")
    look = part.visibility_table
    for row in (look.best_incidence_rad, look.blocker, look.too_coarse, look.blurred):
        _require(row.shape == (samples,), "evidence of another number of samples")
    _require(part.covered.shape == (grasps, samples), "coverage of another number of grasps")
    _require(part.home_q.shape == (grasps, 6), "configurations of another number of grasps")
    for per_grasp in (part.shown, part.shown_open, part.view_q):
        _require(len(per_grasp) == grasps, "views of another number of grasps")
    for by_direction in part.view_q:
        for direction, q in by_direction.items():
            _require(0 <= direction < views, "no such direction")
            _require(q.ndim == 2 and q.shape[1] == 6, "configurations of other joints")
    _require(len(part.hand_offs) == len(part.fixed_grasps), "hand-offs of other grasps")
    _require(len(part.set_downs) == len(part.rests), "paths to set down at other places")
    for partners in (*part.hand_offs, *part.set_downs):
        for grasp, meeting in partners.items():
            _require(0 <= grasp < grasps, "no such grasp")
            for path in (meeting.entry, meeting.retreat):
                _require(path.ndim == 2 and path.shape[1] == 6, "a path of other joints")
            _require(meeting.q.shape == (6,), "a meeting of other joints")
    for rest in part.rests:
        _require(is_pose(rest.T_world_part), "T_world_part is no pose")
    for held in (*part.arm_grasps, *part.fixed_grasps):
        _check_fields(held, samples, "grasp")


def _check_samples(samples: SurfaceSamples, face_count: int) -> None:
    """Raise ValueError if arrays of samples do not fit together, or lie on no face."""
    count = len(samples.points_mm)
    for row in (samples.points_mm, samples.normals):
        _require(row.shape == (count, 3), "samples of another shape")
    for numbers in (samples.face_ids, samples.areas_mm2):
        _require(numbers.shape == (count,), "samples of another number")
    _require(bool((samples.areas_mm2 >= 0).all()), "an area below zero")
    _require(_are_below(samples.face_ids, face_count), "a sample on no surface")


def _check_counted(counted: Counted, chosen_count: int, face_count: int) -> None:
    """Raise ValueError if the sample points of coverage do not fit a part."""
    _check_samples(counted.samples, face_count)
    _check_samples(counted.probes, face_count)
    count, look = len(counted.samples.points_mm), counted.evidence
    rows = (look.is_hidden, look.best_incidence_rad, look.blocker, look.too_coarse, look.blurred)
    for row in (counted.nearest, *rows):
        _require(row.shape == (count,), "evidence of another number of points")
    _require(counted.of_chosen.shape == (chosen_count,), "points of other samples")
    _require(_are_below(counted.nearest, chosen_count), "no such sample")
    _require(_are_below(counted.of_chosen, count), "no such point")


def _are_below(numbers: NDArray[np.integer], count: int) -> bool:
    return bool(((numbers >= 0) & (numbers < count)).all())


def is_pose(T: FloatArray) -> bool:
    """Return whether a matrix is a pose (4, 4): a rotation and a translation."""
    if T.shape != (4, 4) or not np.isfinite(T).all():
        return False
    R = T[:3, :3]
    is_rotation = np.allclose(R @ R.T, np.eye(3), atol=ROTATION_TOLERANCE)
    return bool(is_rotation and np.linalg.det(R) > 0 and np.array_equal(T[3], [0, 0, 0, 1]))


def _check_fields(value: object, sample_count: int, where: str) -> None:
    """Raise ValueError if a field of a plan has another shape than fields of its name have."""
    assert is_dataclass(value)
    for field in fields(value):
        inner, name = getattr(value, field.name), field.name
        at = f"{where}.{name}"
        if name in POSES:
            _require(is_pose(inner), f"{at} is no pose")
        elif name in VECTORS:
            _require(inner.shape == (VECTORS[name],), f"{at} has another length")
        elif name in PATHS:
            _require(all(q.shape == (6,) for q in inner), f"{at} is of other joints")
        elif name == "seen":
            _require(inner.shape == (sample_count,), f"{at} is of other samples")
        elif isinstance(inner, np.ndarray):
            raise ValueError(f"{at}: an array of no known shape")
        elif isinstance(inner, float):
            _require(isfinite(inner), f"{at} is no number")
            if name == "seconds" or name.endswith(("_mm", "_mm2", "_s")):
                _require(inner >= 0, f"{at} is below zero")
        elif isinstance(inner, Solid):
            continue
        else:
            for item in _items(inner):
                if is_dataclass(item):
                    _check_fields(item, sample_count, at)


def _items(value: object) -> Iterable[object]:
    if isinstance(value, Mapping):
        return value.values()
    return value if isinstance(value, tuple) else (value,)


def _require(holds: bool, otherwise: str) -> None:
    if not holds:
        raise ValueError(otherwise)
