"""Plans and certificates of a part in a cell, each in a file of the cache.

A file's key covers everything that decides its content: the part, the cell in the planner's terms,
the planner's options and source, the libraries it computes with, and the pose of the part. So a
file cannot be stale: a change of any of them is another file.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from controller.arrays import FloatArray
from controller.cache import digest_of, source_hash, versions
from controller.cad import StablePose
from controller.cad.compiled import CompiledPart
from controller.planning import (
    CellLayout,
    Certificate,
    NoPlanError,
    OnTable,
    Plan,
    PlanOptions,
    PreparedPart,
    certify,
    plan_from,
    prepare_part,
    resting_pose,
)
from controller.planning.model import ArmModel

from .stored import FORMAT, Certified, KeptPlan, PartCaches

__all__ = ["Certified", "KeptPlan", "PlanCache", "planner_hash"]


SOURCES = ("controller/cad", "controller/imaging", "controller/planning", "drivers/umi_scara")
DECIDING = ("numpy", "scipy", "shapely", "trimesh", "embreex", "python-fcl", "rtree")


class PlanCache:
    """Plans of one part in one cell, from the cache if they are there.

    Parameters
    ----------
    part : the compiled part
    layout : the cell
    options : options of the planner
    use_cache : False to make everything anew and store nothing
    """

    def __init__(
        self,
        part: CompiledPart,
        layout: CellLayout,
        options: PlanOptions | None = None,
        *,
        use_cache: bool = True,
    ) -> None:
        self._part = part
        self._layout = layout
        self._options = options or PlanOptions()
        self._use_cache = use_cache
        self._prepared: PreparedPart | None = None
        self._kept = PartCaches(part)
        self._key = digest_of(
            FORMAT,
            part.solid.content_hash,
            part.solid.unit,
            part.samples,  # coverage is counted by them; their density is an option
            layout,
            self._options,
            planner_hash(),
            model_hash(layout.arm),
        )
        self._made = 0
        self._known: dict[Path, KeptPlan] = {}

    @property
    def is_from_cache(self) -> bool:
        """Whether the cache had everything so far."""
        return self._made == 0

    @property
    def is_prepared(self) -> bool:
        """Whether the long work is already done."""
        if self._prepared is not None:
            return True
        return (
            self._use_cache and self._kept.prepared.file(self._part.solid.name, self._key).exists()
        )

    def prepared(self) -> PreparedPart:
        """Return the part prepared for this cell.

        Raises
        ------
        NoPlanError : nothing can hold it
        """
        if self._prepared is None:
            file = self._kept.prepared.file(self._part.solid.name, self._key)
            found = self._kept.prepared.load(file) if self._use_cache else None
            if found is None:
                self._made += 1
                part = self._part
                found = prepare_part(
                    part.solid, part.chosen_by, self._layout, self._options, part.samples
                )
                if self._use_cache:
                    self._kept.prepared.save(file, found)
            self._prepared = found
        return self._prepared

    def plan_at(self, pose: StablePose, x_mm: float, y_mm: float, theta_rad: float) -> KeptPlan:
        """Return the plan for the part at rest in a pose on the table, or why there is none.

        Parameters
        ----------
        pose : the stable pose
        x_mm, y_mm : position of the centre of mass on the table
        theta_rad : turn about +z
        """
        T = resting_pose(self._part.solid, pose, x_mm, y_mm, theta_rad)
        file = self._plan_file(pose.index, T)
        found = self._known.get(file)
        if found is None and self._use_cache:
            found = self._kept.plans.load(file)
        if found is None:
            self._made += 1
            try:
                plan = plan_from(self.prepared(), self._layout, OnTable(pose.index, T))
                found = KeptPlan(pose.index, T, plan)
            except NoPlanError as error:
                found = KeptPlan(pose.index, T, None, str(error))
            if self._use_cache:
                self._kept.plans.save(file, found)
        self._known[file] = found
        return found

    def certified(self, pose: StablePose) -> Certified:
        """Return the certificate of a stable pose, in the middle of the area where parts may rest.

        Of poses that a symmetry of the part makes one, the first is planned, for all.
        """
        if not pose.is_distinct:
            first = self.certified(self._part.poses[pose.same_as])
            own = replace(
                first.certificate,
                pose_index=pose.index,
                probability=pose.probability,
                same_as=pose.same_as,
            )
            return replace(first, certificate=own)
        file = self._certificate_file(pose)
        found = self._kept.certificates.load(file) if self._use_cache else None
        if found is None:
            self._made += 1
            found = self._certify(pose)
            if self._use_cache:
                self._kept.certificates.save(file, found)
        x_mm, y_mm = self._layout.set_down_mm.mean(axis=1).tolist()
        T = resting_pose(self._part.solid, pose, x_mm, y_mm)
        kept = KeptPlan(pose.index, T, found.certificate.plan, found.certificate.reason)
        self._known[self._plan_file(pose.index, T)] = kept
        return found

    def known_plan(self, pose: StablePose) -> Plan | None:
        """Return the plan of a stable pose's certificate; None if the cache has none.

        Parameters
        ----------
        pose : the stable pose
        """
        found = self._kept.certificates.load(self._certificate_file(pose))
        return None if found is None else found.certificate.plan

    def is_certified(self, pose: StablePose) -> bool:
        """Return whether the cache has a certificate file for a stable pose, valid or not."""
        return self._certificate_file(pose).exists()

    def _certificate_file(self, pose: StablePose) -> Path:
        key = digest_of(self._key, "certificate", pose.first_alike)
        return self._kept.certificates.file(self._part.solid.name, key)

    def _certify(self, pose: StablePose) -> Certified:
        try:
            part = self.prepared()
        except NoPlanError as error:  # nothing can hold it, in any stable pose
            certificate = Certificate(pose.index, pose.probability, None, str(error), 0.0)
            return Certified(certificate, 0, 0)
        (certificate,) = certify(part, self._layout, (pose,))
        return Certified(certificate, len(part.arm_grasps), len(part.fixed_grasps))

    def _plan_file(self, pose_index: int, T_world_part: FloatArray) -> Path:
        return self._kept.plans.file(
            self._part.solid.name, digest_of(self._key, pose_index, T_world_part)
        )


@lru_cache(maxsize=1)
def planner_hash() -> str:
    """Return a hash of all source that decides a plan, and of the libraries' versions."""
    root = Path(__file__).parents[3]
    return digest_of(source_hash(*(root / room for room in SOURCES)), versions(*DECIDING))


def model_hash(arm: ArmModel) -> str:
    """Return a hash of the source of an arm's model: its package, or its file if it has none."""
    module = sys.modules[type(arm).__module__]
    source = Path(module.__file__ or "")
    if module.__package__:
        return source_hash(source.parent)
    return digest_of(source.read_text(encoding="utf-8"))
