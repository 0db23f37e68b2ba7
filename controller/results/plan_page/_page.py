"""Puts the page of a plan together: strip, time line, coverage map, reasons."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from controller.cad import Solid, StablePose
from controller.cad.compiled import CompiledPart
from controller.cell.plans import KeptPlan
from controller.planning import CellLayout, Certificate, Plan

from ..moments import moments, view_count
from ..pages import make_environment, write_page
from ..ray_drawing import as_uri
from .coverage import CoverageMap, coverage_map
from .paint import Painter
from .strip import AGAIN, BEFORE, NEW, OUTLINE, Strip, StripFrame, width_for
from .timeline import Timeline, timeline

TEMPLATES = ("plan.html.j2", "plan.css")


@dataclass(frozen=True, slots=True, eq=False)
class PlanFacts:
    """The content of the page.

    Attributes
    ----------
    cell : its name
    certificates : certificates of all stable poses; empty where only one was planned from
    place : planar pose of the part: x [mm], y [mm], theta [deg]
    inputs : inputs of the plan and its certificates, in a sentence
    """

    part: CompiledPart
    cell: str
    layout: CellLayout
    kept: KeptPlan
    certificates: tuple[Certificate, ...]
    place: tuple[float, float, float]
    inputs: str

    @property
    def pose(self) -> StablePose:
        """The stable pose that the plan starts from."""
        return next(p for p in self.part.poses if p.index == self.kept.pose_index)


@dataclass(frozen=True, slots=True)
class ReasonRow:
    """A piece of a face that no view shows."""

    face: str
    share: float
    kind: str
    reason: str
    advice: str


@dataclass(frozen=True, slots=True, eq=False)
class DrawnPlan:
    """A plan as the page shows it."""

    frames: tuple[StripFrame, ...]
    map: CoverageMap
    timeline: Timeline
    reasons: tuple[ReasonRow, ...]


def write_plan_page(facts: PlanFacts, path: Path) -> Path:
    """Write the page of a plan, or of why there is none, and return its path.

    Raises
    ------
    OSError : the file cannot be written
    """
    return write_page(render_plan(facts), path)


def render_plan(facts: PlanFacts) -> str:
    """Return the page."""
    environment = make_environment(__package__, TEMPLATES)
    environment.filters["uri"] = as_uri
    environment.filters["hex"] = lambda c: "#" + "".join(f"{round(v):02x}" for v in c)
    plan = facts.kept.plan
    return environment.get_template("plan.html.j2").render(
        facts=facts,
        plan=plan,
        view_count=view_count,
        drawn=None if plan is None else draw_plan(facts, plan),
        colours={"new": NEW, "again": AGAIN, "before": BEFORE, "outline": OUTLINE},
    )


def draw_steps(facts: PlanFacts, plan: Plan, painter: Painter) -> tuple[StripFrame, ...]:
    """Return all steps of a plan, drawn.

    Parameters
    ----------
    facts, plan : facts and plan to draw
    painter : colours of the part by its samples
    """
    samples = facts.part.samples
    weights = np.asarray(samples.areas_mm2 / samples.areas_mm2.sum())
    steps = moments(plan, facts.layout)
    strip = Strip(facts.part.solid, facts.layout, painter, width_for(len(steps)))
    return tuple(strip.frames(steps, weights))


def write_step_pictures(facts: PlanFacts, plan: Plan, folder: Path) -> tuple[tuple[str, str], ...]:
    """Write two pictures of each step; return their names: in close-up, and from outside.

    Parameters
    ----------
    facts, plan : facts and plan to draw
    folder : is there

    Raises
    ------
    OSError : a file cannot be written
    """
    names = []
    for frame in draw_steps(facts, plan, Painter(facts.part.solid, facts.part.samples)):
        near, outside = f"step-{frame.number}.png", f"step-{frame.number}-outside.png"
        (folder / near).write_bytes(frame.near)
        (folder / outside).write_bytes(frame.outside)
        names.append((near, outside))
    return tuple(names)


def draw_plan(facts: PlanFacts, plan: Plan) -> DrawnPlan:
    """Return the drawings of a plan."""
    solid, samples = facts.part.solid, facts.part.samples
    painter = Painter(solid, samples)
    frames = draw_steps(facts, plan, painter)
    return DrawnPlan(
        frames=frames,
        map=coverage_map(solid, samples, plan, painter, facts.pose.R),
        timeline=timeline(frames),
        reasons=reason_rows(solid, plan),
    )


def reason_rows(solid: Solid, plan: Plan) -> tuple[ReasonRow, ...]:
    """Return the unseen pieces, the largest first."""
    return tuple(
        ReasonRow(
            face=solid.faces[u.face_id].label,
            share=u.area_fraction,
            kind=u.kind.value,
            reason=u.reason,
            advice=u.advice,
        )
        for u in plan.unseen
    )
