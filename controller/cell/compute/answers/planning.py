"""Answers about plans: for a part on the table or in a gripper, and among other objects."""

import math
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from controller import planning
from controller import recognition as recognising
from controller.arrays import BoolArray, FloatArray, Grey
from controller.cad.compiled import load_part
from controller.cell.custody import ALONE, Around
from controller.cell.journal.rows import SightingFields
from controller.planning import (
    Ambiguity,
    FaceToShowAgain,
    OnTable,
    Plan,
    PreparedPart,
    Start,
    TableHypothesis,
)
from controller.planning.regrasps import pick_paths

from ...plans import PlanCache
from ..job import MAX_RECIPE_COUNT, Job, context
from ..neighbours import layout_among


def prepare(job: Job) -> float:
    """Do all planning that does not depend on the part's pose; return the duration [s]."""
    started = time.monotonic()
    _prepared(job)
    return time.monotonic() - started


def plan(
    job: Job,
    start: Start,
    seen: BoolArray | None,
    avoid: frozenset[str],
    alternatives: tuple[recognising.Alternative, ...],
    around: Around = ALONE,
    short: frozenset[FaceToShowAgain] = frozenset(),
) -> Plan:
    """Return a plan for the part, which a gripper or the table has.

    Parameters
    ----------
    job : recipe and cell
    start : present state of the part
    seen : (n,) bool, samples that need not be shown again
    avoid : ids of grasps that have failed
    alternatives : the other parts and poses that recognition has not excluded
    around : other objects in the cell
    short : faces to show again, from other grasps

    Raises
    ------
    NoPlanError : there is no plan; the message gives the reason
    """
    prepared, layout = _prepared(job), layout_among(context(job), around)
    if isinstance(start, OnTable) and alternatives:
        hypotheses = _hypotheses(job, alternatives)
        return planning.plan_under_ambiguity(
            prepared, layout, start, hypotheses, seen=seen, avoid=avoid
        )
    return planning.plan_from(prepared, layout, start, seen=seen, avoid=avoid, short=short)


def _hypotheses(
    job: Job, alternatives: tuple[recognising.Alternative, ...]
) -> list[TableHypothesis]:
    """Return each other hypothesis about the picture, with the solid of its part."""
    c = context(job)
    rest = (load_part(*file) for file in c.files)
    solids = {part.solid.name: part.solid for part in (*rest, c.part)}
    return [TableHypothesis(a.part, solids[a.part], a.T_world_part) for a in alternatives]


def plan_to_trays(job: Job, start: Start, avoid: frozenset[str], around: Around = ALONE) -> Plan:
    """Return a plan that brings the part to a tray without showing it on the way.

    Parameters
    ----------
    job : recipe and cell
    start : present state of the part
    avoid : ids of grasps that have failed
    around : other objects in the cell

    Raises
    ------
    NoPlanError : no path leads to the trays; the message gives the reason
    """
    prepared = _prepared(job)
    nothing_left = np.ones(len(prepared.counted_samples.points_mm), dtype=bool)
    layout = layout_among(context(job), around)
    return planning.plan_from(prepared, layout, start, seen=nothing_left, avoid=avoid)


@dataclass(frozen=True, slots=True)
class Pickable:
    """The ways to take a part from among the other objects on the table.

    Attributes
    ----------
    path_count : paths a gripper has to it; 0 where it cannot be taken
    forecast_s : duration of its inspection by the certificate of its stable pose [cell s]
    """

    path_count: int = 0
    forecast_s: float = math.inf


def pickable(job: Job, sightings: tuple[SightingFields, ...]) -> tuple[Pickable, ...]:
    """Return the ways to take each part from among the others; other recipes' parts have none.

    Parameters
    ----------
    job : recipe and cell
    sightings : all sightings on the table
    """
    name, prepared = context(job).solid.name, _prepared(job)
    found = []
    for number, seen in enumerate(sightings):
        others = (*sightings[:number], *sightings[number + 1 :])
        count = 0
        if seen.part == name and seen.T_world_part is not None:
            with suppress(planning.NoPlanError):
                paths = pick_paths(
                    prepared,
                    layout_among(context(job), Around(others)),
                    np.array(seen.T_world_part),
                )
                count = len(paths)
        forecast_s = _forecasts(job).get(seen.pose_index, math.inf) if count else math.inf
        found.append(Pickable(count, forecast_s))
    return tuple(found)


@lru_cache(maxsize=MAX_RECIPE_COUNT)
def _forecasts(job: Job) -> Mapping[int, float]:
    """Return the forecast duration [cell s] per stable pose with a certificate."""
    c = context(job)
    cache = PlanCache(c.part, c.layout, c.setup.options)
    plans = {pose.index: cache.known_plan(pose) for pose in c.poses}
    return {index: plan.forecast_s for index, plan in plans.items() if plan is not None}


def identify(
    job: Job,
    ambiguity: Ambiguity,
    q: FloatArray,
    opening_mm: float,
    backlit: Grey,
    lit: tuple[Grey, ...],
) -> tuple[int, ...]:
    """Return the hypotheses that agree with the pictures of the disambiguation view; () if none.

    Parameters
    ----------
    job : recipe and cell
    ambiguity : the hypotheses, and the view that decides between them
    q : (6,) configuration of the arm
    opening_mm : opening of the arm gripper
    backlit, lit : pictures of the view
    """
    return planning.identify(ambiguity, context(job).layout, q, opening_mm, backlit, lit).left


def surface_share(job: Job, samples: BoolArray) -> float:
    """Return the share of the part's surface that the given samples (n,) stand for, 0..1."""
    areas = context(job).samples.areas_mm2
    return float(areas[samples].sum() / areas.sum())


@lru_cache(maxsize=MAX_RECIPE_COUNT)
def _prepared(job: Job) -> PreparedPart:
    c = context(job)
    return PlanCache(c.part, c.layout, c.setup.options).prepared()
