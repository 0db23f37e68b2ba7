"""Where a parallel jaw can hold a part: seeds, one evaluator, what friction and pose errors leave.

Each stage is cheaper than the next and counts what it leaves and how near the best came, so that
a part which cannot be held is refused with the number that fails (planning.md 2.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controller.cad import RayCaster, Solid

from ..boxes import BoolArray
from ..errors import NotGraspableError
from ..grip import Grip, GripRules, Holder
from ..layout import FloatArray, Jaw
from ._candidates import axis_distance, candidates, open_gap, pre_open, way_seems_free
from ._clearance import PartTriangles, clear_of_part, lifts_off_table
from ._pads import Contacts, PadGrid, close_pads
from ._robust import margins
from ._seeds import Seeds, needed_friction, widest_inner
from ._select import cover
from ._strength import GRAVITY_N_PER_KG, least_load, loads

FULL_CONTACT_MM2 = 120.0  # more contact does not make a grip surer
NO_OFFSET_MM = 12.0  # contacts this far apart leave nothing of a grip's score
SORTING_SHARE = 0.8  # of the contact asked for, that coarse rays must find


@dataclass(frozen=True, slots=True)
class Stage:
    """What one stage left: how many grips, and the best value it saw of what it asks for.

    `best` and `limit` are nan for a stage that asks for no number.
    """

    name: str
    left: int
    best: float = float("nan")
    limit: float = float("nan")
    unit: str = ""

    @property
    def phrase(self) -> str:
        """How people read it."""
        if not np.isfinite(self.limit):
            return f"{self.name} {self.left}"
        best = f"best {self.best:.3g}" if np.isfinite(self.best) else "none came near"
        return f"{self.name} {self.left} ({best}, {self.limit:.3g}{self.unit} asked)"


@dataclass(frozen=True, slots=True)
class Synthesis:
    """Every grip of a jaw on a part, and what each stage left."""

    grips: tuple[Grip, ...]
    stages: tuple[Stage, ...]


def synthesise_grips(
    solid: Solid,
    seeds: Seeds,
    caster: RayCaster,
    jaw: Jaw,
    holder: Holder,
    downs: FloatArray,
    rules: GripRules,
    gravities: Sequence[FloatArray] | None = None,
) -> tuple[Grip, ...]:
    """Return grips of one jaw that hold the part, clear of it, from all round and from above.

    Parameters
    ----------
    seeds : of `find_seeds`
    downs : (k, 3) which way is down, in the part frame, in each stable pose
    gravities : unit vectors (3,) in the tip frame, of a jaw that does not turn; None: of the arm's

    Raises
    ------
    NotGraspableError : no grip holds; says which stage left none, and the number that failed
    """
    found = judge_grips(solid, seeds, caster, jaw, holder, downs, rules, gravities)
    if not found.grips:
        raise NotGraspableError(_refusal(solid, seeds, caster, jaw, holder, rules, found.stages))
    return found.grips


def _refusal(
    solid: Solid,
    seeds: Seeds,
    caster: RayCaster,
    jaw: Jaw,
    holder: Holder,
    rules: GripRules,
    stages: Sequence[Stage],
) -> str:
    """Say which stage left no grip, with the number that fails."""
    last = next(s for s in stages if s.left == 0)
    name = f"{solid.name}: the {holder} cannot hold it"
    if last.name == "tried":
        need, width = needed_friction(solid, seeds, caster)
        have = float(np.degrees(np.arctan(rules.friction)))
        widest = jaw.max_mm - rules.jaw_reserve_mm
        if need > have:
            return (
                f"{name}: widest opposed friction angle needed {need:.1f} deg, have {have:.1f}; "
                "fit pads that grip better, or fingers shaped for it"
            )
        return (
            f"{name}: no two opposed walls at most {widest:.0f} mm apart, the nearest are "
            f"{width:.1f} mm apart; fit a wider jaw or other fingers"
        )
    tallies = "; ".join(s.phrase for s in stages[: stages.index(last) + 1])
    return f"{name}; grips left by each demand: {tallies}"


def judge_grips(
    solid: Solid,
    seeds: Seeds,
    caster: RayCaster,
    jaw: Jaw,
    holder: Holder,
    downs: FloatArray,
    rules: GripRules,
    gravities: Sequence[FloatArray] | None = None,
) -> Synthesis:
    """Return what `synthesise_grips` does, and the tally of every stage; none is no error."""
    judge = _Judge(solid, caster, jaw, rules, gravities)
    tried = candidates(solid, seeds, jaw, downs, rules)
    stages = [Stage("tried", len(tried.T))]

    bound = least_load(
        axis_distance(tried.T, solid.centroid_mm, jaw),
        judge.weight_n,
        jaw.force_n,
        judge.coarse,
        rules,
    )
    able = bound <= rules.max_load
    best = bound.min(initial=np.inf)
    tried = tried.take(able)
    stages.append(
        Stage("with a short enough lever", len(tried.T), best, rules.max_load, " of the limit")
    )
    free = way_seems_free(tried, seeds, jaw, rules)
    tried = tried.take(free)
    stages.append(Stage("with a way in", len(tried.T)))

    found = close_pads(
        caster, judge.face_normals, tried.T, tried.gap, tried.inner, judge.coarse, rules
    )
    rows = judge.sorted_out(stages, found, tried.inner, judge.coarse, SORTING_SHARE)
    found, inner = found.take(rows), tried.inner[rows]

    # only the arm takes parts from the table
    picks = _picks(solid, found, inner, jaw, downs if holder == "arm" else downs[:0], rules)
    rows = cover(found.T, _score(found), picks, rules.checked_n, rules.checked_n // 8)
    found, inner = found.take(rows), inner[rows]
    clear = clear_of_part(PartTriangles(solid), found.T, found.opening, inner, jaw, rules)
    found, inner, picks = found.take(np.flatnonzero(clear)), inner[clear], picks[:, rows][:, clear]
    stages.append(Stage("clear of the part", len(found.T)))

    rows = cover(found.T, _score(found), picks, rules.fine_n, 2 * rules.picks_n)
    found, inner, picks = found.take(rows), inner[rows], picks[:, rows]
    found = close_pads(caster, judge.face_normals, found.T, found.opening, inner, judge.fine, rules)
    rows = judge.sorted_out(stages, found, inner, judge.fine, 1.0, "measured finely")
    found, inner, picks = found.take(rows), inner[rows], picks[:, rows]
    load = judge.load(found, inner, judge.fine)
    margin = margins(
        caster,
        judge.face_normals,
        found,
        inner,
        solid.centroid_mm,
        jaw,
        judge.coarse,
        rules,
        lambda contacts, which: judge.holds(
            contacts, inner[which], judge.coarse, rules.least_contact_mm2
        ),
    )
    sure = np.flatnonzero(margin >= rules.min_margin - 1e-9)
    stages.append(
        Stage("sure of a wrong pose", len(sure), margin.max(initial=0.0), rules.min_margin)
    )
    score = _score(found) * (1.0 - load) * margin
    kept = [
        int(sure[k])
        for k in cover(found.T[sure], score[sure], picks[:, sure], rules.keep_n, rules.picks_n)
    ]
    wide = pre_open(found.opening, inner, jaw, rules)
    grips = tuple(
        Grip(
            id=f"{holder[0].upper()}{number}",
            T_part_hand=found.T[k],
            opening_mm=float(found.opening[k]),
            pre_open_mm=float(wide[k]),
            contact_mm2=float(found.area[k]),
            load=float(load[k]),
            score=float(score[k]),
            holder=holder,
            margin=float(margin[k]),
            is_inner=bool(inner[k]),
        )
        for number, k in enumerate(kept)
    )
    return Synthesis(grips, (*stages, Stage("chosen", len(grips))))


class _Judge:
    """What all stages ask of one part in one jaw."""

    def __init__(
        self,
        solid: Solid,
        caster: RayCaster,
        jaw: Jaw,
        rules: GripRules,
        gravities: Sequence[FloatArray] | None,
    ) -> None:
        self.solid, self.caster, self.jaw, self.rules = solid, caster, jaw, rules
        self.gravities = gravities
        self.face_normals = np.asarray(solid.mesh.face_normals)
        self.weight_n = solid.volume_mm3 * rules.density_kg_mm3 * GRAVITY_N_PER_KG
        self.coarse = PadGrid.of(jaw, rules.ray_step_mm)
        self.fine = PadGrid.of(jaw, rules.fine_step_mm)

    def load(self, found: Contacts, inner: BoolArray, grid: PadGrid) -> FloatArray:
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
        jaw, rules = self.jaw, self.rules
        low = np.where(inner, 2 * jaw.finger_thickness_mm + 2 * rules.bore_clearance_mm, 1.0)
        high = np.where(inner, widest_inner(jaw), jaw.max_mm - rules.jaw_reserve_mm)
        return np.asarray(found.touched & (found.opening >= low) & (found.opening <= high))

    def holds(
        self, found: Contacts, inner: BoolArray, grid: PadGrid, contact_mm2: float
    ) -> BoolArray:
        """Tell which contacts are good for every rule (n,)."""
        good = self.in_width(found, inner) & (found.area >= contact_mm2)
        good &= found.offset <= self.rules.max_offset_mm
        rows = np.flatnonzero(good)
        good[rows] = self.load(found.take(rows), inner[rows], grid) <= self.rules.max_load
        return np.asarray(good)

    def sorted_out(
        self,
        stages: list[Stage],
        found: Contacts,
        inner: BoolArray,
        grid: PadGrid,
        share: float,
        prefix: str = "",
    ) -> FloatArray:
        """Return the numbers of the grips that hold, and tell the stages what each rule left."""
        rules = self.rules
        rows = np.flatnonzero(self.in_width(found, inner))
        name = f"{prefix}: " if prefix else ""
        if not prefix:
            stages.append(Stage("touched by both pads", len(rows)))
        area = found.area[rows]
        least = share * rules.min_contact_mm2
        best = area.max(initial=0.0)
        rows = rows[area >= least]
        stages.append(Stage(f"{name}enough contact", len(rows), best, least, " mm2"))
        offset = found.offset[rows]
        best = offset.min(initial=np.inf)
        rows = rows[offset <= rules.max_offset_mm]
        stages.append(
            Stage(
                f"{name}contacts opposite each other", len(rows), best, rules.max_offset_mm, " mm"
            )
        )
        load = self.load(found.take(rows), inner[rows], grid)
        best = load.min(initial=np.inf)
        rows = rows[load <= rules.max_load]
        stages.append(
            Stage(f"{name}strong enough", len(rows), best, rules.max_load, " of the limit")
        )
        return rows


def _picks(
    solid: Solid,
    found: Contacts,
    inner: BoolArray,
    jaw: Jaw,
    downs: FloatArray,
    rules: GripRules,
) -> BoolArray:
    """Tell for each way the part lies which grips take it from above (k, n)."""
    hull = np.asarray(solid.mesh.convex_hull.vertices)
    wide = open_gap(found.opening, inner, jaw, rules)
    picks = [lifts_off_table(found.T, wide, jaw, hull, down) for down in downs]
    return np.array(picks, dtype=bool).reshape(len(downs), len(found.T))


def _score(found: Contacts) -> FloatArray:
    area = np.minimum(1.0, found.area / FULL_CONTACT_MM2)
    return np.asarray(area * np.maximum(0.05, 1.0 - found.offset / NO_OFFSET_MM))
