"""`cellctl compile`: what follows from CAD files alone."""

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE
from rich.table import Table

from controller.cad import CadError, StablePose
from controller.cad.compiled import (
    CompiledPart,
    CompileOptions,
    cached_part,
    compile_part,
    make_part,
)
from controller.cad.surfaces.features import Feature
from controller.cad.surfaces.tolerances import Datum, Dimension, GeometricTolerance, Tolerance
from controller.cad.views import LineView
from controller.cell.plans import Certified, Planning
from controller.config import ConfigError, load_cell
from controller.results.sheet import write_sheet
from controller.setup.planner import planner_setup

from ..inputs.checks import check_writable_folder
from ..inputs.part_files import PartFile
from ..planning.part_plan import print_certificates
from ..planning.plan_json import certificate_json
from ..terminal.output import emit, say, stdout, warn


def compile_parts(
    files: Sequence[PartFile],
    *,
    density_g_cm3: float | None,
    report: Path | None,
    cell: Path | None,
    use_cache: bool,
    as_json: bool,
) -> int:
    """Report what follows from CAD files; 2 if one is wrong, the others are reported all the same.

    Parameters
    ----------
    files : CAD files, with the recipe of each
    density_g_cm3 : of all parts; the recipe's, the file's, or aluminium's otherwise
    report : HTML page to write, None for none
    cell : cell file; with it come the grasps of each part there, and a plan for each stable pose
    use_cache : read and keep compiled parts and plans
    as_json : print one JSON object a part

    Raises
    ------
    ConfigError : the cell file is wrong, or the report cannot be written
    """
    recipes = [file.recipe for file in files if file.recipe is not None]
    on_command_line = density_g_cm3
    if recipes and on_command_line is not None:
        raise ConfigError("--density is not allowed with --recipe: the recipe has `density_g_cm3:`")
    density_g_cm3 = recipes[0].density_g_cm3 if recipes else on_command_line
    if report is not None:
        check_writable_folder(report.parent, "--report in")
    planned_in = None if cell is None else load_cell(cell)
    code, parts = 0, []
    for file in files:
        started = time.perf_counter()
        try:
            part, from_cache = _compiled(file.path, file.options, use_cache=use_cache)
        except CadError as error:
            warn(f"cellctl: {error}")
            code = 2
            continue
        seconds = time.perf_counter() - started
        parts.append(part)
        body = part_json(part, density_g_cm3) | {"seconds": seconds, "from_cache": from_cache}
        if not as_json:
            _print(part, body)
        certified = None
        if planned_in is not None:
            setup = planner_setup(file.recipe, planned_in, part, on_command_line)
            if not as_json:
                say(setup.sentence)
            planning = Planning(part, setup.layout, setup.options, use_cache=use_cache)
            certified = [planning.certified(pose) for pose in part.poses]
            body |= {"planned_with": setup.as_json()} | certified_json(certified)
        if as_json:
            emit(body)
        elif certified is not None:
            _print_certified(part, certified)
    if report is not None and parts:
        try:
            written = write_sheet(parts, density_g_cm3, report)
        except OSError as error:
            raise ConfigError(f"--report {report}: {error.strerror or error}") from error
        if not as_json:
            say(f"report: {written}")
    return code


def _compiled(path: Path, options: CompileOptions, *, use_cache: bool) -> tuple[CompiledPart, bool]:
    if not use_cache:
        return compile_part(path, options), False
    kept = cached_part(path, options)
    return (make_part(path, options), False) if kept is None else (kept, True)


def part_json(part: CompiledPart, density_g_cm3: float | None) -> dict[str, Any]:
    """Return a compiled part as conventions.md 7 promises it; R are nested row-major lists."""
    solid, boundary = part.solid, part.solid.boundary
    density = part.density_g_cm3(density_g_cm3)
    return {
        "part": solid.name,
        "content_hash": solid.content_hash,
        "unit": solid.unit,
        "unit_declared": solid.unit_is_declared,
        "size_mm": solid.mesh.extents.tolist(),
        "volume_mm3": solid.volume_mm3,
        "area_mm2": float(solid.mesh.area),
        "centroid_mm": solid.centroid_mm.tolist(),
        "density_g_cm3": density,
        "mass_g": solid.volume_mm3 / 1000 * density,
        "triangles": len(solid.mesh.faces),
        "stable_poses": [
            _pose_json(part, pose, view) for pose, view in zip(part.poses, part.views, strict=True)
        ],
        "faces": [
            {
                "face": f.id,
                "kind": f.kind,
                "label": f.label,
                "area_mm2": f.area_mm2,
                "normal": np.round(f.normal, 6).tolist(),
                "axis": np.round(f.axis, 6).tolist(),
                "centre_mm": f.centre_mm.tolist(),
                "radius_mm": f.radius_mm,
                "concave": f.concave,
                "samples": int(part.sample_counts[f.id]),
            }
            for f in solid.faces
        ],
        "features": [_feature_json(feature) for feature in part.features],
        "tolerances": [_tolerance_json(tolerance) for tolerance in part.tolerances],
        "edges": boundary.edge_count,
        "vertices": len(boundary.vertex_ids),
        "loops": len(boundary.first),
        "shells": boundary.shell_count,
        "genus": boundary.genus,
        "euler_defect": part.euler_defect,
        "warnings": list(part.cautions),
    }


def certified_json(certified: Sequence[Certified]) -> dict[str, Any]:
    """Return how many ways there are to hold a part, and what each stable pose comes to."""
    return {
        "grasps": {
            "arm": max((c.arm_grasp_count for c in certified), default=0),
            "fixture": max((c.fixed_grasp_count for c in certified), default=0),
        },
        "certificates": [certificate_json(c.told) for c in certified],
    }


def _pose_json(part: CompiledPart, pose: StablePose, view: LineView) -> dict[str, Any]:
    return {
        "index": pose.index,
        "R": pose.R.tolist(),
        "up": pose.R[2].tolist(),
        "probability": pose.probability,
        "drop_probability": pose.drop_probability,
        "tip_energy_mj_per_kg": pose.tip_energy_mj_per_kg,
        "stability_rank": pose.stability_rank,
        "com_height_mm": pose.com_height_mm,
        "rolling": pose.rolling,
        "rocking": pose.rocking,
        "marginal": pose.marginal,
        "same_as": pose.same_as,
        "view": {
            "area_mm2": view.area,
            "perimeter_mm": view.perimeter,
            "loops": len(view.loops),
            "holes": sum(loop.is_hole for loop in view.loops),
            "edges": len(view.edges),
        },
    }


def _feature_json(feature: Feature) -> dict[str, Any]:
    return {
        "kind": feature.kind,
        "label": feature.label,
        "faces": list(feature.faces),
        "diameter_mm": feature.diameter_mm,
        "depth_mm": feature.depth_mm,
        "width_mm": feature.width_mm,
        "length_mm": feature.length_mm,
        "axis": feature.axis.tolist(),
        "position_mm": feature.position_mm.tolist(),
        "through": feature.is_through,
        "concave": feature.is_concave,
        "steps": [asdict(step) for step in feature.steps],
    }


def _tolerance_json(tolerance: Tolerance) -> dict[str, Any]:
    what = {Dimension: "dimension", GeometricTolerance: "geometric", Datum: "datum"}
    return {"tolerance": what[type(tolerance)], **asdict(tolerance)}


def _print_certified(part: CompiledPart, certified: Sequence[Certified]) -> None:
    grasps = certified_json(certified)["grasps"]
    say(
        f"grasps: {grasps['arm']} of the arm gripper, {grasps['fixture']} of the fixed gripper; "
        f"certificates of {part.solid.name}:"
    )
    print_certificates([c.told for c in certified])


def _print(part: CompiledPart, body: dict[str, Any]) -> None:
    solid = part.solid
    size = " x ".join(f"{v:.1f}" for v in body["size_mm"])
    say(
        f"{solid.name}: {size} mm, {solid.volume_mm3 / 1000:.1f} cm3, {body['mass_g']:.0f} g, "
        f"{body['triangles']} triangles, {len(solid.faces)} surfaces, {body['edges']} edges, "
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
    say(f"surfaces: {', '.join(counts)}; {len(part.samples.points_mm)} samples")
    if part.features:
        labels = Counter(feature.label for feature in part.features)
        told = (f"{count} x {label}" if count > 1 else label for label, count in labels.items())
        say(f"features: {'; '.join(told)}")
    if part.tolerances:
        say(f"tolerances: {len(part.tolerances)} required by the drawing")
