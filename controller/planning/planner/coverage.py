"""Coverage of a plan's steps, counted by points by which its views were not chosen (ADR 57)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from controller.arrays import BoolArray
from controller.imaging import RayCaster

from ..model import CellLayout, Look, PreparedPart, Present, Step
from ..views import Counter


def count_shown(
    part: PreparedPart, layout: CellLayout, steps: Sequence[Step], before: BoolArray
) -> tuple[tuple[Step, ...], BoolArray]:
    """Return the steps with the counted points that each shows, and those of all (m,).

    Parameters
    ----------
    part : prepared
    layout : the cell
    steps : steps with the samples shown, among those that views are chosen by
    before : (m,) points inspected before
    """
    seen = before.copy()
    if part.counted is None:
        for step in steps:
            if isinstance(step, Present | Look):
                seen |= step.seen
        return tuple(steps), seen
    caster = RayCaster(part.solid.mesh)
    counter = Counter(part.solid, part.counted.samples, layout, part.options, caster)
    out: list[Step] = []
    for step in steps:
        match step:
            case Present():
                shown = counter.held_up(step.grasp, step.q)
            case Look():
                shown = counter.on_table(step.T_world_part)
            case _:
                out.append(step)
                continue
        seen |= shown
        out.append(replace(step, seen=shown))
    return tuple(out), seen


def counted_as(part: PreparedPart, able: BoolArray, seen: BoolArray) -> BoolArray:
    """Return a mask (m,) of the counted points that could be shown.

    Parameters
    ----------
    part : prepared
    able : (n,) mask of the reachable samples among those that views are chosen by
    seen : (m,) points that are shown
    """
    counted = part.counted
    if counted is None:
        return able | seen
    return seen | (able[counted.nearest] & ~counted.evidence.is_hidden)
