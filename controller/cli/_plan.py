"""`cellctl plan`: how a part would be shown, at what cost, and why not the rest; nothing moves."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE
from rich.table import Table

from controller.cad import StablePose
from controller.cad.compiled import CompiledPart, CompileOptions, load_part
from controller.cell.plans import Certificate, KeptPlan, Planning, certificate
from controller.config import Cell, ConfigError, build_layout, load_cell
from controller.planning import CellLayout, Plan

from ._output import emit, say, stdout, warn
from ._plan_json import certificate_json, plan_json

Place = tuple[float, float, float]  # x [mm], y [mm], theta [deg]


def plan_part_file(
    part: Path,
    cell_path: Path,
    pose_index: int | None,
    at: str | None,
    *,
    unit: str | None,
    report: Path | None,
    use_cache: bool,
    as_json: bool,
) -> int:
    """Plan one part at one place; without a pose, from every way it may lie.

    Raises
    ------
    ConfigError, CadError : a file or an option is wrong
    NoPlanError : asked for one pose, and there is no plan from it
    """
    cell = load_cell(cell_path)
    layout = build_layout(cell)
    place = parse_place(at, cell.table.drop_area.x, cell.table.drop_area.y)
    compiled = load_part(part, CompileOptions(unit=unit))
    poses = _asked(compiled, pose_index)
    started = time.monotonic()
    planning = Planning(compiled, layout, use_cache=use_cache)
    kept, told = _plan_all(planning, poses, place)
    body = _head(compiled, cell, kept, place)
    seconds = time.monotonic() - started
    if kept.plan is None:
        reason = _no_plan(compiled, kept, told)
        if as_json:
            body |= {"steps": [], "error": reason}
        else:
            _print_certificates(told)
        warn(f"cellctl: {reason}")
    elif as_json:
        body |= plan_json(compiled.solid, compiled.samples, layout, kept.plan)
    else:
        _print(compiled, kept.plan, body)
        if pose_index is None:
            _print_certificates(told)
    if as_json:
        emit(
            body
            | {"certificates": [certificate_json(c) for c in told]}
            | {"seconds": seconds, "from_cache": planning.is_from_cache}
        )
    if report is not None:
        _write_report(compiled, cell, layout, kept, told, place, report, as_json=as_json)
    return 0 if kept.plan is not None else 1


def _asked(part: CompiledPart, pose_index: int | None) -> tuple[StablePose, ...]:
    if pose_index is None:
        return part.poses
    found = tuple(pose for pose in part.poses if pose.index == pose_index)
    if not found:
        known = ", ".join(str(pose.index) for pose in part.poses)
        raise ConfigError(f"--pose {pose_index}: {part.solid.name} has poses {known or 'none'}")
    return found


def _plan_all(
    planning: Planning, poses: Sequence[StablePose], place: Place
) -> tuple[KeptPlan, tuple[Certificate, ...]]:
    """Return the plan from the likeliest pose that has one, and what every pose comes to."""
    if not poses:
        raise ConfigError("the part has no pose to lie in: it rolls whichever way it lies")
    x_mm, y_mm, theta_deg = place
    likeliest_first = sorted(poses, key=lambda p: (-p.probability, p.index))
    chosen: KeptPlan | None = None
    told: dict[int, Certificate] = {}
    for pose in likeliest_first:
        kept = planning.lying(pose, x_mm, y_mm, float(np.radians(theta_deg)))
        told[pose.index] = certificate(pose, kept)
        if chosen is None or (chosen.plan is None and kept.plan is not None):
            chosen = kept
    assert chosen is not None
    return chosen, tuple(told[index] for index in sorted(told))


def _head(part: CompiledPart, cell: Cell, kept: KeptPlan, place: Place) -> dict[str, Any]:
    pose = next(p for p in part.poses if p.index == kept.pose_index)
    return {
        "part": part.solid.name,
        "cell": cell.name,
        "pose": pose.index,
        "probability": pose.probability,
        "x_mm": place[0],
        "y_mm": place[1],
        "theta_deg": place[2],
        "T_world_part": kept.T_world_part.tolist(),
    }


def _no_plan(part: CompiledPart, kept: KeptPlan, told: Sequence[Certificate]) -> str:
    """Return one sentence; where all poses fail for one reason, that reason."""
    if len({c.reason for c in told}) == 1:
        return str(kept.failure)
    reasons = "; ".join(f"from pose {c.pose_index}: {c.reason}" for c in told)
    return f"{part.solid.name}: no plan from any of its {len(told)} poses: {reasons}"


def _print(part: CompiledPart, plan: Plan, head: dict[str, Any]) -> None:
    say(
        f"{head['part']} in cell {head['cell']}, lying in pose {head['pose']} "
        f"({head['probability']:.0%}) at ({head['x_mm']:.0f}, {head['y_mm']:.0f}) mm, "
        f"{head['theta_deg']:.0f} deg"
    )
    for i, (label, step_s) in enumerate(plan.seconds_by_step, 1):
        say(f"{i:3}  {step_s:6.1f} s  {label}")
    say(
        f"forecast {plan.forecast_s:.0f} s; {plan.covered_fraction:.1%} of the surface seen, "
        f"{plan.reachable_fraction:.1%} could be"
    )
    say(proof_words(plan))
    for u in plan.unseen:
        remedy = f"; {u.remedy}" if u.remedy else ""
        label = part.solid.faces[u.face_id].label
        say(f"  {label}: {u.area_fraction:.2%} unseen, {u.reason}{remedy}")


def proof_words(plan: Plan) -> str:
    """Return what is proven of a plan, and among what, as a sentence."""
    proof = plan.proof
    if proof.cost_s <= 0:
        return "not proven: nothing was searched exactly"
    if proof.is_optimal:
        return f"proven optimal: {proof.scope}"
    return f"within {proof.gap:.1%} of the optimum: {proof.scope}"


def certificate_words(told: Certificate) -> str:
    """Return what a pose comes to, in words."""
    if not told.is_planned:
        return told.reason
    shown = told.covered_fraction / told.reachable_fraction if told.reachable_fraction else 1.0
    views = f"{told.view_count} view{'' if told.view_count == 1 else 's'}"
    regrips = f"{told.regrip_count} re-grip{'' if told.regrip_count == 1 else 's'}"
    return f"{views}, {regrips}, {told.forecast_s:.0f} s, {shown:.1%} of what can be shown"


def _print_certificates(told: Sequence[Certificate]) -> None:
    table = Table(box=SIMPLE, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("from pose", justify="right")
    table.add_column("likely\n%", justify="right")
    table.add_column("what it comes to", min_width=30)
    for c in told:
        table.add_row(str(c.pose_index), f"{100 * c.probability:.1f}", certificate_words(c))
    stdout.print(table)


def _write_report(
    part: CompiledPart,
    cell: Cell,
    layout: CellLayout,
    kept: KeptPlan,
    told: tuple[Certificate, ...],
    place: Place,
    path: Path,
    *,
    as_json: bool,
) -> None:
    from controller.results.plan_page import PlanFacts, write_plan_page

    facts = PlanFacts(part=part, cell=cell.name, layout=layout, kept=kept, told=told, place=place)
    try:
        written = write_plan_page(facts, path)
    except OSError as error:
        raise ConfigError(f"--report {path}: {error.strerror or error}") from error
    if not as_json:
        say(f"report: {written}")


def parse_place(at: str | None, x: tuple[float, float], y: tuple[float, float]) -> Place:
    """Return x, y [mm] and theta [deg] of ``X,Y,THETA``; the middle of the area otherwise.

    Raises
    ------
    ConfigError : not three numbers
    """
    if at is None:
        return sum(x) / 2, sum(y) / 2, 0.0
    try:
        numbers = [float(word) for word in at.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 3 or not np.isfinite(numbers).all():
        raise ConfigError(f"--at {at}: three numbers are asked, X,Y,THETA_DEG, as in 350,20,45")
    return numbers[0], numbers[1], numbers[2]
