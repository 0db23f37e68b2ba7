"""`cellctl plan --site`: the best places of inspection camera and fixed gripper for some parts."""

import time
from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import Any

from rich.box import SIMPLE
from rich.table import Table

from controller.cad.compiled import load_part
from controller.cell.plans import PlanCache
from controller.config import load_cell
from controller.setup.layout import build_layout
from controller.setup.planner import planner_setup
from controller.siting import (
    CellSite,
    SiteOptions,
    SiteReport,
    SiteScore,
    site_report,
)

from ..inputs.part_files import PartFile
from ..terminal.output import emit, print_line, stderr, stdout


def site_parts(
    files: Sequence[PartFile], cell_path: Path, *, use_cache: bool, as_json: bool
) -> int:
    """Search and print the best places of camera and fixed gripper; return the exit code.

    Parameters
    ----------
    files : the parts to show, each with its recipe
    cell_path : cell file; its camera and fixed gripper are where the search begins
    use_cache : read and keep compiled and prepared parts
    as_json : print one JSON object instead of sentences

    Raises
    ------
    ConfigError, CadError : a file is wrong
    NoPlanError : a part cannot be held at all
    """
    cell = load_cell(cell_path)
    layout = build_layout(
        cell.model_copy(update={"chute": None})
    )  # built for the place that is found
    parts = [load_part(file.path, file.options) for file in files]
    setups = [
        planner_setup(file.recipe, cell, part) for file, part in zip(files, parts, strict=True)
    ]
    glowing = cell.table.glowing_area
    options = SiteOptions(keep_free_mm=(glowing.x, glowing.y))
    started = time.monotonic()
    with stderr.status("preparing parts") as status:
        prepared = [
            PlanCache(part, setup.layout, setup.options, use_cache=use_cache).prepared()
            for part, setup in zip(parts, setups, strict=True)
        ]

        def progress(what: str, done: int, total: int) -> None:
            status.update(f"{what}: {done} of {total}")

        report = site_report(prepared, layout, options, progress)
    seconds = time.monotonic() - started
    if as_json:
        head = {"parts": [part.solid.name for part in parts], "cell": cell.name}
        figures = {"planned_with": [setup.as_json() for setup in setups]}
        emit(head | figures | site_json(report) | {"seconds": seconds})
        return 0
    for part, setup in zip(parts, setups, strict=True):
        print_line(f"{part.solid.name}: {setup.sentence}")
    for sentence in report.sentences:
        print_line(sentence)
    _print(report)
    return 0


def site_json(report: SiteReport) -> dict[str, Any]:
    """Return the report as JSON; poses are nested row-major lists in world coordinates."""
    return {
        "stay": report.stay,
        "sentences": list(report.sentences),
        "joints_allow": report.joints_allow,
        "sites_tried": report.sites_tried,
        "sites_checked": report.sites_checked,
        "present": _score_json(report.present),
        "best": _score_json(report.best),
        "others": [_score_json(score) for score in report.others],
        "T_world_camera": report.T_camera.tolist(),
        "boxes": {
            name: {"T": box.T.tolist(), "half_mm": box.half_mm.tolist()}
            for name, box in report.boxes.items()
        },
    }


def _score_json(score: SiteScore) -> dict[str, Any]:
    return {
        "site": _site_json(score.site),
        "value": score.value,
        "shown_mean": score.shown_mean,
        "shown_worst": score.shown_worst,
        "forbidden": score.forbidden,
        "trays": dict(score.trays),
        "parts": [
            {
                "part": part.name,
                "showable": part.showable,
                "joints_allow": part.joints_allow,
                "shown": part.shown,
                "shown_worst": part.shown_worst,
                "views_share": part.views_share,
                "partners_share": part.partners_share,
                "hand_offs_share": part.hand_offs_share,
                "picks_share": part.picks_share,
                "view_s": _number(part.view_s),
                "regrip_s": _number(part.regrasp_s),
            }
            for part in score.parts
        ],
    }


def _site_json(site: CellSite) -> dict[str, Any]:
    T = site.T_world_fixed_tcp
    return {
        "station_mm": site.station_mm.tolist(),
        "camera_looks_along": site.looks_along.tolist(),
        "T_world_fixture": None if T is None else T.tolist(),
    }


def _number(value: float) -> float | None:
    """Return a number; None for NaN and infinity, which JSON lacks."""
    return value if isfinite(value) else None


def _print(report: SiteReport) -> None:
    table = Table(box=SIMPLE, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("part")
    for heading in ("could be\n%", "shown now\n%", "at best\n%", "picked now\n%", "at best\n%"):
        table.add_column(heading, justify="right", no_wrap=True)
    for now, best in zip(report.present.parts, report.best.parts, strict=True):
        table.add_row(
            now.name,
            f"{100 * best.showable:.1f}",
            f"{100 * now.shown:.1f}",
            f"{100 * best.shown:.1f}",
            f"{100 * now.picks_share:.0f}",
            f"{100 * best.picks_share:.0f}",
        )
    stdout.print(table)
