"""Requirements of each stage of the synthesis, and the tally of grasps that each left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.cad import Solid
from controller.imaging import RayCaster
from messages import key, say

from ..model import GraspRules, Jaw
from .contact import GRAVITY_N_PER_KG, Contacts, PadGrid, close_pads, loads
from .seeds import GraspCandidates, narrowest_inner, widest_inner

FULL_CONTACT_MM2 = 120.0  # more contact does not make a grasp surer
NO_OFFSET_MM = 12.0  # contacts this far apart leave nothing of a grasp's score


@dataclass(frozen=True, slots=True)
class FilterStage:
    """Result of one requirement: the number of grasps left, and the best value measured.

    `best` and `limit` are nan for a requirement without a limit.
    """

    name: str
    left: int
    best: float = float("nan")
    limit: float = float("nan")
    unit: str = ""

    @property
    def phrase(self) -> str:
        """The stage as messages name it."""
        if not np.isfinite(self.limit):
            return say("{name} {left}", name=self.name, left=self.left)
        best = (
            say("best {best:.3g}", best=self.best)
            if np.isfinite(self.best)
            else key("none came so far")
        )
        return say(
            "{name} {left} ({best}, {limit:.3g}{unit} required)",
            name=self.name,
            left=self.left,
            best=best,
            limit=self.limit,
            unit=self.unit,
        )


class StageTally:
    """Tally of stages in the order of their first use, summed over batches."""

    def __init__(self) -> None:
        self._stages: dict[str, FilterStage] = {}

    def count(self, name: str, left: int) -> None:
        """Add to the tally of a stage without a limit."""
        before = self._stages.get(name)
        self._stages[name] = FilterStage(name, left + (before.left if before else 0))

    def require(
        self, name: str, values: FloatArray, limit: float, unit: str = "", *, most: bool = False
    ) -> BoolArray:
        """Return a mask (n,) of the values that reach a limit; keep their number and the best.

        Parameters
        ----------
        name : name of the stage; asked again, it adds up
        values : (n,)
        limit : in the unit of the values
        unit : as it follows the number in a message, with its blank
        most : the limit is the most allowed, not the least
        """
        good = values <= limit + 1e-9 if most else values >= limit - 1e-9
        before = self._stages.get(name, FilterStage(name, 0))
        best = values.min(initial=np.inf) if most else values.max(initial=-np.inf)
        if np.isfinite(before.best):
            best = min(best, before.best) if most else max(best, before.best)
        self._stages[name] = FilterStage(
            name, before.left + int(good.sum()), float(best), limit, unit
        )
        return np.asarray(good)

    @property
    def stages(self) -> tuple[FilterStage, ...]:
        """The stages so far, in the order of their first use."""
        return tuple(self._stages.values())


class Judge:
    """Evaluator of grasps for one part, one jaw and one set of rules.

    Parameters
    ----------
    solid : the part
    caster : rays against its mesh
    jaw : the gripper
    rules : requirements on a grasp
    gravities : unit vectors (3,) in the TCP frame, of a jaw that does not turn; None: of the arm's
    """

    def __init__(
        self,
        solid: Solid,
        caster: RayCaster,
        jaw: Jaw,
        rules: GraspRules,
        gravities: Sequence[FloatArray] | None,
    ) -> None:
        self.solid, self.caster, self.jaw, self.rules = solid, caster, jaw, rules
        self.gravities = gravities
        self.tally = StageTally()
        self.hull = solid.hull_mm
        self.face_normals = np.asarray(solid.mesh.face_normals, dtype=np.float32)
        self.weight_n = solid.volume_mm3 * rules.density_kg_mm3 * GRAVITY_N_PER_KG
        self.coarse = PadGrid.of(jaw, rules.ray_step_mm)
        self.fine = PadGrid.of(jaw, rules.fine_step_mm)

    def close(
        self, T: FloatArray, gap: FloatArray, inner: BoolArray, grid: PadGrid, slopes: bool = False
    ) -> Contacts:
        """Return the contacts of the pads, as `close_pads`.

        Parameters
        ----------
        T : (n, 4, 4) T_part_tcp
        gap : (n,) distance between the surfaces expected to touch [mm]
        inner : (n,) the pads are the fingers' backs and move apart
        grid : the rays of a pad
        slopes : work out the gradients too
        """
        return close_pads(self.caster, self.face_normals, T, gap, inner, grid, self.rules, slopes)

    def load(self, found: Contacts, inner: BoolArray, grid: PadGrid) -> FloatArray:
        """Return the share of each grasp's strength that the weight uses (n,).

        Parameters
        ----------
        found : n contacts, closed
        inner : (n,) the pads are the fingers' backs
        grid : the rays they were closed with
        """
        return loads(
            found,
            grid,
            self.solid.centroid_mm,
            self.weight_n,
            self.jaw.force_n,
            inner,
            self.rules,
            self.gravities,
        )

    def in_width(self, found: Contacts, inner: BoolArray) -> BoolArray:
        """Return a mask (n,) of contacts by both pads, within the opening range of the jaw."""
        low = np.where(inner, narrowest_inner(self.jaw, self.rules), 1.0)
        high = np.where(inner, widest_inner(self.jaw), self.jaw.max_mm - self.rules.jaw_reserve_mm)
        return np.asarray(found.touched & (found.opening >= low) & (found.opening <= high))

    def holds(self, found: Contacts, inner: BoolArray, contact_mm2: float) -> BoolArray:
        """Return a mask (n,) of the contacts that meet every rule.

        Parameters
        ----------
        found : n contacts, closed with the coarse grid
        inner : (n,) the pads are the fingers' backs
        contact_mm2 : least contact of either pad
        """
        good = self.in_width(found, inner) & (found.area >= contact_mm2)
        good &= found.offset <= self.rules.max_offset_mm
        rows = np.flatnonzero(good)
        load = self.load(found.take(rows), inner[rows], self.coarse)
        good[rows] = load <= self.rules.max_load
        return np.asarray(good)

    def sort_out(
        self,
        found: Contacts,
        inner: BoolArray,
        grid: PadGrid,
        contact_mm2: float,
        prefix: str = "",
    ) -> IntArray:
        """Return the numbers of the grasps that hold; keep each demand's tally.

        Parameters
        ----------
        found : n contacts, closed
        inner : (n,) the pads are the fingers' backs
        grid : the rays they were closed with
        contact_mm2 : least contact of either pad
        prefix : prefix of the stages' names in the tally
        """
        rules, tally = self.rules, self.tally
        rows = np.flatnonzero(self.in_width(found, inner))
        tally.count(say("{prefix}touched by both pads", prefix=prefix), len(rows))
        good = tally.require(
            say("{prefix}enough contact", prefix=prefix), found.area[rows], contact_mm2, " mm2"
        )
        rows = rows[good]
        good = tally.require(
            say("{prefix}contacts opposite", prefix=prefix),
            found.offset[rows],
            rules.max_offset_mm,
            key(" mm apart"),
            most=True,
        )
        rows = rows[good]
        load = self.load(found.take(rows), inner[rows], grid)
        good = tally.require(
            say("{prefix}strong enough", prefix=prefix),
            load,
            rules.max_load,
            key(" of the friction limit"),
            most=True,
        )
        return np.asarray(rows[good])


def score_of(found: Contacts) -> FloatArray:
    """Return the score of each grasp, by contact and offset alone (n,), 0..1."""
    area = np.minimum(1.0, found.area / FULL_CONTACT_MM2)
    return np.asarray(area * np.maximum(0.05, 1.0 - found.offset / NO_OFFSET_MM))


def closed(tried: GraspCandidates, found: Contacts, rows: IntArray) -> GraspCandidates:
    """Return some of the candidates in their closed poses.

    Parameters
    ----------
    tried : the candidates
    found : contacts, one set for each
    rows : numbers of those to return
    """
    return GraspCandidates(found.T[rows], found.opening[rows], tried.inner[rows])
