"""Judges plans: does each view show what it says, does every piece of surface have its reason.

Shares no code with `controller.planning`, whose dataclasses it reads: own kinematics and contacts
(planning_contacts), own exact sight lines (planning_sight), own search for views of
what a plan leaves unseen (planning_showable).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from planning_checker import Moment, follow
from planning_contacts import finger_boxes, frames
from planning_showable import Class, Evidence, Showable
from planning_sight import Seen, VisibilityRules, box_triangles, in_sight

from controller.cad import Solid, SurfaceSamples
from controller.planning import (
    CellLayout,
    Grasp,
    Jaw,
    Look,
    Plan,
    PlanOptions,
    Present,
    Reason,
    Start,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SEARCHED_COUNT = 80  # unseen samples that views are searched for, per plan
PER_FACE_COUNT = 10
KINDS = {
    Reason.HIDDEN_BY_PART: Class.HIDDEN,
    Reason.FINGERS: Class.FINGERS,
    Reason.REACH: Class.REACH,
}


@dataclass
class Verdict:
    """What the judge found; shares are of the surface.

    Attributes
    ----------
    trouble : contacts, limits, custody, holds; one sentence each
    false_claims : (view, sample) a view is said to show and does not
    open_claims : claims that hang on less than the tolerances; missed_claims : (view, sample) seen
        and not claimed
    covered, falsely_covered : truly seen, and counted by the plan without being so
    showable_unseen : what the search found a view for, with any grip the planner had
    left_out : of that, what the plan itself says it left out or has no path to
    wrong_kinds : unseen surface whose reason the search does not confirm
    undecided : unseen surface the search was not through with
    floor_regrips : 1 where every grip the part can be taken with hides, under its pads, surface
        that is showable and not seen from above
    """

    trouble: list[str] = field(default_factory=list)
    claims: int = 0
    false_claims: int = 0
    open_claims: int = 0
    missed_claims: int = 0
    covered: float = 0.0
    falsely_covered: float = 0.0
    claimed: float = 0.0
    showable_unseen: float = 0.0
    left_out: float = 0.0
    wrong_kinds: float = 0.0
    undecided: float = 0.0
    floor_regrips: int = 0
    evidence: list[Evidence] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    states: int = 0
    cpu_s: float = 0.0

    @property
    def of_showable(self) -> float:
        """Return what the plan shows of what can be shown."""
        return self.covered / max(self.covered + self.showable_unseen, 1e-12)

    @property
    def is_sound(self) -> bool:
        """Tell whether the plan does what it says, without touching anything."""
        return not self.trouble and self.false_claims == 0


class Judge:
    """One part in one cell; keeps what does not depend on the plan."""

    def __init__(
        self,
        solid: Solid,
        samples: SurfaceSamples,
        layout: CellLayout,
        options: PlanOptions | None = None,
    ) -> None:
        options = options or PlanOptions()
        angle, finest = float(np.radians(options.max_incidence_deg)), options.min_px_per_mm
        self.solid, self.samples, self.layout = solid, samples, layout
        self.at_station = VisibilityRules(angle, finest, layout.inspection_sharp_mm)
        self.overhead = VisibilityRules(angle, finest, layout.overhead_sharp_mm)
        self.weights = samples.areas_mm2 / samples.areas_mm2.sum()
        self.search = Showable(layout, solid, samples, self.at_station)

    def judge(
        self,
        plan: Plan,
        start: Start | Array,
        grasps: Sequence[Grasp] = (),
        seen_before: Mask | None = None,
    ) -> Verdict:
        """Return what is true of a plan.

        Parameters
        ----------
        grasps : of the arm that the planner had; without any, nothing is searched for
        seen_before : (n,) samples inspected before the plan began
        """
        began = time.process_time()
        walk = follow(plan, self.layout, self.solid, start)
        verdict = Verdict(trouble=walk.trouble, states=walk.states)
        n = len(self.weights)
        before = np.zeros(n, dtype=bool) if seen_before is None else seen_before
        claimed, truly = before.copy(), before.copy()
        for moment in walk.moments:
            step = moment.step
            assert isinstance(step, Present | Look)
            said = np.asarray(step.seen)
            found = self.sight(moment, said)
            wrong = said & ~found.seen
            verdict.claims += int(said.sum())
            verdict.open_claims += int((wrong & found.open).sum())
            verdict.false_claims += int((wrong & ~found.open).sum())
            verdict.missed_claims += int((found.seen & ~said & ~found.open).sum())
            if (wrong & ~found.open).any():
                faces = np.unique(self.samples.face_ids[wrong & ~found.open])
                verdict.notes.append(
                    f"{step.label} ({step.view_id}): {int((wrong & ~found.open).sum())} samples "
                    f"said to be seen are not, on faces {', '.join(map(str, faces[:8]))}"
                )
            claimed |= said
            truly |= said & (found.seen | found.open)
        verdict.claimed = float(self.weights[claimed].sum())
        verdict.covered = float(self.weights[truly].sum())
        verdict.falsely_covered = float(self.weights[claimed & ~truly].sum())
        if seen_before is None and abs(verdict.claimed - plan.covered_fraction) > 1e-9:
            verdict.trouble.append(
                f"the plan says it covers {plan.covered_fraction:.6f}, "
                f"its views {verdict.claimed:.6f}"
            )
        missing = float(self.weights[~claimed].sum())
        named = sum(u.area_fraction for u in plan.unseen)
        if abs(missing - named) > 5e-3:
            verdict.trouble.append(f"{missing:.4f} is unseen, reasons are given for {named:.4f}")
        if grasps:
            self._look_for(plan, ~claimed, grasps, verdict)
        verdict.floor_regrips = self._floor(walk.moments, truly, grasps or plan.grasps)
        verdict.cpu_s = time.process_time() - began
        return verdict

    def sight(self, moment: Moment, said: Mask) -> Seen:
        """Return what is in sight at a moment of the plan."""
        is_look = isinstance(moment.step, Look)
        camera = self.layout.overhead if is_look else self.layout.inspection
        R, t = moment.T_world_part[:3, :3], moment.T_world_part[:3, 3]
        tip = frames(self.layout, moment.q)["tip"]
        hand = [
            *((b.T, b.half_mm) for b in self.layout.arm_gripper.body),
            *finger_boxes(self.layout.arm_gripper, moment.arm_opening_mm),
        ]
        occluders = [self.search.triangles @ R.T + t]
        occluders += [box_triangles(tip @ T, half) for T, half in hand]
        eye = camera.T_world_cam[:3, 3]
        occluders += self.search.world(moment.q, moment.fixed_opening_mm, eye)
        return in_sight(
            self.samples.points_mm @ R.T + t,
            self.samples.normals @ R.T,
            camera,
            np.vstack(occluders),
            self.overhead if is_look else self.at_station,
            said,
        )

    def _look_for(
        self, plan: Plan, unseen: Mask, grasps: Sequence[Grasp], verdict: Verdict
    ) -> None:
        """Search for views of unseen samples, face by face, and hold the reasons against it."""
        faces = self.samples.face_ids
        chosen = _spread(np.flatnonzero(unseen), faces)
        classes, verdict.evidence = self.search.classify(chosen.tolist(), grasps)
        said: dict[int, Reason] = {k: u.kind for u in plan.unseen for k in u.samples}
        found: dict[tuple[int, Reason | None, Class], float] = {}
        for k, what in zip(chosen.tolist(), classes, strict=True):
            mine = unseen & (faces == faces[k])
            # each sample that was looked into stands for its share of the face's unseen surface
            area = float(self.weights[mine].sum()) / int((faces[chosen] == faces[k]).sum())
            kind = said.get(k)
            if what is Class.UNDECIDED:
                verdict.undecided += area
            elif what is Class.SHOWABLE:
                verdict.showable_unseen += area
                verdict.left_out += 0.0 if kind in KINDS else area
            if kind in KINDS and what is not Class.UNDECIDED and what is not KINDS[kind]:
                verdict.wrong_kinds += area
                key = (int(faces[k]), kind, what)
                found[key] = found.get(key, 0.0) + area
        for (face, kind, what), area in found.items():
            assert kind is not None
            verdict.notes.append(
                f"face {face} ({self.solid.faces[face].label}): {100 * area:.2f} % of the surface "
                f"is said to be out of sight for {kind.value}, the search finds it {what.value}"
            )

    def _floor(self, moments: Sequence[Moment], covered: Mask, grasps: Sequence[Grasp]) -> int:
        """Return 1 where opaque pads make one regrasp unavoidable (planning-facts.md 0.3)."""
        above = np.zeros(len(covered), dtype=bool)
        for m in moments:
            if isinstance(m.step, Look):
                above |= np.asarray(m.step.seen)
        wanted = covered & ~above
        held = [g for g in grasps if g.holder == "arm"]
        return int(all((wanted & self.under_pads(g, self.layout.arm_gripper)).any() for g in held))

    def under_pads(self, grasp: Grasp, jaw: Jaw) -> Mask:
        """Tell which samples lie under the pads, a millimetre inside their outline (n,)."""
        T = np.linalg.inv(grasp.T_part_tcp)
        at = self.samples.points_mm @ T[:3, :3].T + T[:3, 3]
        facing = np.abs(self.samples.normals @ grasp.T_part_tcp[:3, 1]) > 0.9
        under = (at[:, 0] < -1) & (at[:, 0] > 1 - jaw.pad_length_mm) & facing
        under &= np.abs(at[:, 2]) < jaw.finger_width_mm / 2 - 1
        return np.asarray(under & (np.abs(np.abs(at[:, 1]) - grasp.opening_mm / 2) < 0.3))


def _spread(rows: NDArray[np.int64], faces: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return up to SEARCHED_COUNT samples, some of every face, evenly along their order."""
    per_face = [rows[faces[rows] == f] for f in np.unique(faces[rows])]
    most = PER_FACE_COUNT
    while most > 1 and sum(min(most, len(r)) for r in per_face) > SEARCHED_COUNT:
        most -= 1
    picked = [
        r[np.linspace(0, len(r) - 1, min(most, len(r))).round().astype(int)] for r in per_face
    ]
    return np.concatenate(picked)[:SEARCHED_COUNT] if picked else np.zeros(0, dtype=np.int64)
