"""`cellctl compile`: everything that follows from CAD files alone."""

import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE
from rich.table import Table

from controller.cad import CadError
from controller.cad.compiled import (
    CompiledPart,
    cached_part,
    compile_part,
    make_part,
    part_name,
)
from controller.cad.reading.step.choosing import size_text
from controller.catalogue import Made, PartWork
from controller.cell.plans import Certified, PlanCache
from controller.config import Cell, ConfigError, load_cell
from controller.inspection.characteristics import Characteristic
from controller.results.sheet import write_part_drawings, write_sheet
from controller.setup.characteristics import part_characteristics
from controller.setup.planner import PlannerSetup, planner_setup

from ..inputs.ahead import jobs_among, working_ahead
from ..inputs.checks import check_drawings, check_writable_folder, writing
from ..inputs.part_files import PartFile, part_files
from ..planning.certificates import certified_each, print_certificates
from ..planning.characteristics import print_characteristics
from ..terminal.output import emit, print_line, stdout, warn
from ..terminal.progress import shown_progress
from .arguments import PartsOptions
from .bodies import BodyFiles, every_body
from .part_json import certified_json, part_json


def compile_parts(options: PartsOptions) -> int:
    """Report what follows from CAD files; return 2 if one is wrong, after reporting the others.

    Raises
    ------
    ConfigError : a recipe or the cell file is wrong, or report or drawings cannot be written
    """
    files, cell = _files(options)
    recipes = [file.recipe for file in files if file.recipe is not None]
    if recipes and options.density_g_cm3 is not None:
        raise ConfigError("--density is not allowed with --recipe: the recipe has `density_g_cm3:`")
    density_g_cm3 = recipes[0].density_g_cm3 if recipes else options.density_g_cm3
    report, drawings, as_json = options.report, options.drawings, options.as_json
    use_cache, all_bodies = not options.without_cache, options.all_bodies
    if report is not None:
        check_writable_folder(report.parent, "--report in")
    check_drawings(drawings, 0 if all_bodies else len(files))
    planned_in = None if cell is None else load_cell(cell)
    code, compiled = 0, 0
    parts: list[CompiledPart] = []
    listed = every_body(files) if all_bodies else BodyFiles.of(files)
    if not listed.is_whole:
        code = 2
    with working_ahead(
        jobs_among(options.jobs, use_cache=use_cache),
        [_work(one.file, cell, options.density_g_cm3) for one in listed.files],
    ) as made:
        for number, one in enumerate(listed.files):
            try:
                part, from_cache, seconds = _compiled(
                    one.file, made(number), use_cache=use_cache, as_json=as_json
                )
            except CadError as error:
                warn(f"cellctl: {error}")
                if all_bodies:
                    listed.report_refused(one, error, as_json=as_json)
                code = 2
                continue
            compiled += 1
            if report is not None:
                parts.append(part)
            characteristics = _characteristics(one.file, part)
            body = part_json(part, density_g_cm3, characteristics) | {
                "seconds": seconds,
                "from_cache": from_cache,
                **one.body,
            }
            if drawings is not None:
                with writing("--drawings", drawings):
                    names = write_part_drawings(part, drawings)
                for entry, name in zip(body["stable_poses"], names, strict=True):
                    entry["picture"] = name
            if not as_json:
                if all_bodies:
                    listed.print_compiled(one, part, seconds)
                else:
                    _print(part, body)
                if options.lists_characteristics:
                    print_characteristics(characteristics)
            if planned_in is not None:
                body |= _plan(options, one.file, part, planned_in)
            if as_json:
                emit(body)
    if all_bodies and not as_json:
        print_line(f"{compiled} of {len(listed.files)} compiled")
    if report is not None and parts:
        with writing("--report", report):
            written = write_sheet(parts, density_g_cm3, report)
        if not as_json:
            print_line(f"report: {written}")
    return code


def _files(options: PartsOptions) -> tuple[Sequence[PartFile], Path | None]:
    """Return the CAD files, and the cell to plan in."""
    recipes = [] if options.recipe is None else [options.recipe]
    unit = options.unit and options.unit.value
    files, recipe_cell = part_files(list(options.parts or ()), recipes, unit, options.cell)
    has_recipe = any(file.recipe is not None for file in files)
    in_cell = recipe_cell if has_recipe else options.cell
    return files, None if options.without_plans else in_cell


def _plan(options: PartsOptions, file: PartFile, part: CompiledPart, cell: Cell) -> dict[str, Any]:
    """Print grasps and a plan for each stable pose, or return them as JSON."""
    setup = planner_setup(file.recipe, cell, part, options.density_g_cm3)
    if not options.as_json:
        print_line(setup.sentence)
    use_cache = not options.without_cache
    planning = PlanCache(part, setup.layout, setup.options, use_cache=use_cache)
    with shown_progress(part.solid.name, as_json=options.as_json) as progress:
        certified = list(certified_each(planning, part.poses, progress))
    if not options.as_json:
        _print_certified(part, certified, setup)
    return {"planned_with": setup.as_json()} | certified_json(certified, setup)


def _characteristics(file: PartFile, part: CompiledPart) -> tuple[Characteristic, ...]:
    """Return the characteristics of a part; another part's recipe does not apply to it."""
    if file.recipe_path is None:
        return part_characteristics(file.path, None, part)
    return part_characteristics(file.recipe_path, file.recipe, part)


def _work(file: PartFile, cell: Path | None, density_g_cm3: float | None) -> PartWork:
    """Return the work on a part for other processes."""
    return PartWork(file.path, file.options, cell, file.recipe, density_g_cm3)


def _compiled(
    file: PartFile, ahead: Made | None, *, use_cache: bool, as_json: bool
) -> tuple[CompiledPart, bool, float]:
    """Return a part, whether the cache had it, and the seconds that compiling took."""
    path, options = file.path, file.options
    done = None if ahead is None else ahead.compiled
    if done is not None and done.error is not None:
        raise done.error
    started = time.perf_counter()
    with shown_progress(part_name(path), as_json=as_json) as progress:
        if not use_cache:
            part, was_kept = compile_part(path, options, progress.begin), False
        else:
            progress.begin("looking into the cache")
            kept = cached_part(path, options)
            was_kept = kept is not None
            part = kept or make_part(path, options, on_stage=progress.begin)
    if done is not None:
        return part, done.was_kept, done.seconds
    return part, was_kept, time.perf_counter() - started


def _print_certified(
    part: CompiledPart, certified: Sequence[Certified], setup: PlannerSetup
) -> None:
    grasps = certified_json(certified, setup)["grasps"]
    print_line(
        f"grasps: {grasps['arm']} of the arm gripper, {grasps['fixture']} of the fixed gripper; "
        f"certificates of {part.solid.name}:"
    )
    print_certificates([c.certificate for c in certified], setup)


def _print(part: CompiledPart, body: dict[str, Any]) -> None:
    solid = part.solid
    print_line(
        f"{solid.name}: {size_text(body['size_mm'])}, {solid.volume_mm3 / 1000:.1f} cm3, "
        f"{body['mass_g']:.0f} g, {body['triangles']} triangles, {len(solid.faces)} surfaces, "
        f"{body['edges']} edges, "
        f"{body['genus']} handle{'' if body['genus'] == 1 else 's'}"
    )
    for caution in part.cautions:
        warn(f"{solid.name}: {caution}")
    table = Table(box=SIMPLE, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("pose", justify="right")
    table.add_column("up", no_wrap=True)  # the view vector of the paper's Table 1
    for heading in ("gently\n%", "dropped\n%", "tips at\nmJ/kg", "rank", "centre\nmm"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("remarks", min_width=20)
    for pose in part.poses:
        table.add_row(
            str(pose.index),
            " ".join(f"{v + 0.0:g}" for v in np.round(pose.R[2], 4)),
            f"{100 * pose.probability:.1f}",
            f"{100 * pose.drop_probability:.1f}",
            f"{pose.tip_energy_mj_per_kg:.1f}",
            f"{pose.stability_rank}.",
            f"{pose.com_height_mm:.2f}",
            "; ".join((*(["barely stable"] if pose.marginal else []), *part.remarks(pose))),
        )
    stdout.print(table)
    kinds = Counter(face.kind for face in solid.faces)
    counts = [f"{count} {kind}" for kind, count in sorted(kinds.items())]
    print_line(f"surfaces: {', '.join(counts)}; {len(part.samples.points_mm)} samples")
    if part.features:
        labels = Counter(feature.label for feature in part.features)
        labelled = (f"{count} x {label}" if count > 1 else label for label, count in labels.items())
        print_line(f"features: {'; '.join(labelled)}")
    if part.tolerances:
        print_line(f"tolerances: {len(part.tolerances)} required by the drawing")
