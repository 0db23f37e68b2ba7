"""`cellctl plan`: a plan to show a part, its cost, and the reasons for the rest; nothing moves."""

import time
from collections.abc import Callable, Mapping, Sequence
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np

from controller.cad import StablePose
from controller.cad.compiled import CompiledPart, load_part, part_name
from controller.catalogue import PartWork
from controller.cell.plans import KeptPlan, PlanCache
from controller.config import Cell, ConfigError, load_cell
from controller.planning import Certificate
from controller.results.moments import view_count
from controller.setup.faces import faces_left_out
from controller.setup.planner import PlannerSetup, planner_setup

from ..inputs.ahead import jobs_among, working_ahead
from ..inputs.checks import Place, check_drawings, check_writable_folder, parse_place, writing
from ..inputs.part_files import PartFile, stable_pose
from ..terminal.output import emit, print_line, refuse
from ..terminal.progress import PartProgress, shown_progress
from .arguments import PartPlanOptions
from .certificates import (
    certified_each,
    counted,
    covered_words,
    print_certificates,
    proof_words,
)
from .plan_json import certificate_json, plan_json


def plan_part_file(options: PartPlanOptions, part: PartFile, cell_path: Path) -> int:
    """Plan a part at one position, from one stable pose or from each.

    Parameters
    ----------
    options : the command line
    part : the CAD file and its recipe
    cell_path : cell file

    Returns
    -------
    exit code: 0 with a plan; 1 without, after printing the reason

    Raises
    ------
    ConfigError, CadError : a file or an option is wrong
    """
    pose_index, use_cache = options.pose_index, not options.without_cache
    report, drawings, as_json = options.report, options.drawings, options.as_json
    jobs = jobs_among(options.jobs, use_cache=use_cache)
    cell = load_cell(cell_path)
    if report is not None:
        check_writable_folder(report.parent, "--report in")
    check_drawings(drawings, 1)
    place = parse_place(options.at, cell, is_on_table=False)
    with shown_progress(part_name(part.path), as_json=as_json) as progress:
        compiled = load_part(part.path, part.options, on_stage=progress.begin)
    setup = planner_setup(part.recipe, cell, compiled)
    left_out = _left_out(part, compiled)
    poses = _asked(compiled, pose_index)
    started = time.monotonic()
    planning = PlanCache(compiled, setup.layout, setup.options, use_cache=use_cache)
    report_plan = None if as_json else (lambda kept: _print(compiled, cell, kept, place, left_out))
    if not as_json:
        print_line(setup.sentence)
    if report_plan is not None and not planning.is_prepared:
        _report_coarse(compiled, setup, poses[0], place)
    if pose_index is None:
        work = PartWork(part.path, part.options, cell_path, part.recipe)
        with working_ahead(jobs, [work]) as made:
            made(0)
    with shown_progress(compiled.solid.name, as_json=as_json) as progress:
        kept, certificates = _plan_all(
            planning, poses, place, report_plan, progress, is_one=pose_index is not None
        )
    seconds = time.monotonic() - started
    pictures: Sequence[tuple[str, str]] = ()
    facts = None
    if report is not None or drawings is not None:
        from controller.results.plan_page import PlanFacts, write_plan_page, write_step_pictures

        facts = PlanFacts(
            compiled, cell.name, setup.layout, kept, certificates, place, setup.sentence
        )
    if facts is not None and drawings is not None and kept.plan is not None:
        with (
            shown_progress(compiled.solid.name, as_json=as_json) as progress,
            writing("--drawings", drawings),
        ):
            progress.begin("drawing the steps")
            pictures = write_step_pictures(facts, kept.plan, drawings)
    if as_json:
        body = _head(compiled, cell, kept, place) | {"planned_with": setup.as_json()}
        if kept.plan is None:
            body |= {"steps": [], "error": _no_plan(compiled, kept, certificates)}
        else:
            body |= plan_json(compiled.solid, compiled.samples, setup.layout, kept.plan, left_out)
            for step, names in zip(body["steps"], pictures, strict=False):
                step["picture"], step["picture_outside"] = names
        listed = [certificate_json(c, setup) for c in certificates]
        end = {"seconds": seconds, "from_cache": planning.is_from_cache}
        emit(body | {"certificates": listed} | end)
    else:
        print_certificates(certificates, setup)
    if kept.plan is None:
        refuse(_no_plan(compiled, kept, certificates))
    if facts is not None and report is not None:
        with writing("--report", report):
            written = write_plan_page(facts, report)
        if not as_json:
            print_line(f"report: {written}")
    return 0 if kept.plan is not None else 1


def _left_out(part: PartFile, compiled: CompiledPart) -> dict[int, str]:
    """Return the faces that the part's own recipe leaves out, each with the reason."""
    if part.recipe is None or part.recipe_path is None:
        return {}
    return faces_left_out(part.recipe_path, part.recipe, compiled.solid.faces, compiled.features)


def _report_coarse(part: CompiledPart, setup: PlannerSetup, pose: StablePose, place: Place) -> None:
    """Print an estimate from few candidates, seconds before the full plan is ready."""
    started = time.monotonic()
    x_mm, y_mm, theta_deg = place
    quick = PlanCache(part, setup.layout, setup.options.coarse(), use_cache=False)
    plan = quick.plan_at(pose, x_mm, y_mm, float(np.radians(theta_deg))).plan
    if plan is None:
        return  # few candidates prove nothing; the full plan has the reason
    print_line(
        f"first estimate, after {time.monotonic() - started:.1f} s: "
        f"{counted(view_count(plan), 'view')}, {counted(plan.regrasp_count, 'regrasp')}, "
        f"{plan.forecast_s:.0f} s, {plan.covered_fraction:.1%} of the surface in sight; the full "
        "plan follows"
    )


def _asked(part: CompiledPart, pose_index: int | None) -> tuple[StablePose, ...]:
    """Return the poses to try, the likeliest first."""
    poses = sorted(part.poses, key=lambda p: (-p.probability, p.index))
    if not poses:
        raise ConfigError(f"{part.solid.name} has no stable pose: it rolls in every pose")
    return tuple(poses) if pose_index is None else (stable_pose(part, pose_index),)


def _plan_all(
    planning: PlanCache,
    poses: Sequence[StablePose],
    place: Place,
    report_plan: Callable[[KeptPlan], None] | None,
    progress: PartProgress,
    *,
    is_one: bool,
) -> tuple[KeptPlan, tuple[Certificate, ...]]:
    """Return the plan from the likeliest pose that has one, and the certificate of each pose.

    Parameters
    ----------
    report_plan : called with the plan when it is ready, before the other poses are done
    progress : printer of progress
    is_one : one pose was requested, so there are no certificates
    """
    x_mm, y_mm, theta_deg = place
    theta_rad = float(np.radians(theta_deg))
    certificates: dict[int, Certificate] = {}
    chosen: KeptPlan | None = None
    each = repeat(None) if is_one else certified_each(planning, poses, progress)
    for pose, certified in zip(poses, each, strict=False):
        if certified is not None:
            certificates[pose.index] = certified.certificate
        if chosen is None or chosen.plan is None:
            progress.begin(f"plan from stable pose {pose.index}")
            kept = planning.plan_at(pose, x_mm, y_mm, theta_rad)
            if chosen is None or kept.plan is not None:
                chosen = kept
            if kept.plan is not None and report_plan is not None:
                report_plan(kept)
    assert chosen is not None
    return chosen, tuple(certificates[index] for index in sorted(certificates))


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


def _no_plan(part: CompiledPart, kept: KeptPlan, certificates: Sequence[Certificate]) -> str:
    """Return the reason why there is no plan; if the reasons differ, one for each pose."""
    if len({c.reason for c in certificates}) <= 1 or any(c.plan for c in certificates):
        return kept.reason
    reasons = "; ".join(f"from pose {c.pose_index}: {c.reason}" for c in certificates)
    return f"{part.solid.name}: no plan from any of its {len(certificates)} poses: {reasons}"


def _print(
    part: CompiledPart,
    cell: Cell,
    kept: KeptPlan,
    place: Place,
    left_out: Mapping[int, str],
) -> None:
    plan = kept.plan
    assert plan is not None
    head = _head(part, cell, kept, place)
    print_line(
        f"{head['part']} in cell {head['cell']}, stable pose {head['pose']} "
        f"({head['probability']:.0%}) at ({head['x_mm']:.0f}, {head['y_mm']:.0f}) mm, "
        f"{head['theta_deg']:.0f} deg"
    )
    for i, (label, step_s) in enumerate(plan.seconds_by_step, 1):
        print_line(f"{i:3}  {step_s:6.1f} s  {label}")
    print_line(
        f"forecast {plan.forecast_s:.0f} s; {covered_words(plan)} of the surface in sight; "
        f"at most {plan.reachable_fraction:.1%} is possible in this cell"
    )
    print_line(proof_words(plan))
    for u in plan.unseen:
        advice = f"; {u.advice}" if u.advice else ""
        label, why = part.solid.faces[u.face_id].label, left_out.get(u.face_id)
        recipe = f"; the recipe leaves it out: {why}" if why else ""
        print_line(f"  {label}: {u.area_fraction:.2%} not in sight, {u.reason}{advice}{recipe}")
