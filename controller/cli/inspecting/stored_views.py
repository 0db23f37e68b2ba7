"""`cellctl inspect`: read a set of views with its pictures, judge the part, print what came out."""

import json
import time
from dataclasses import dataclass
from pathlib import Path

from controller.arrays import Grey
from controller.cad.compiled import CompiledPart, load_part, options_among, part_name
from controller.config import ConfigError, Recipe, find_recipe, load_recipe
from controller.config.files import read_bytes
from controller.config.view_set import ViewSetFile, load_view_set
from controller.inspection import (
    InspectionLimits,
    PartSettings,
    Verdict,
    inspect_part,
)
from controller.inspection.characteristics import Characteristic
from controller.results.pages import write_page
from controller.setup.faces import faces_left_out
from controller.setup.view_set import build_view_set

from ..inputs.checks import check_writable_folder
from ..inputs.pictures import read_grey
from ..terminal.output import emit, print_line, warn
from .lines import json_lines
from .tables import print_part

MAX_PROBLEM_COUNT = 10  # wrong pictures named at once
MAX_CAD_BYTES = 2**30


@dataclass(frozen=True, slots=True)
class Judged:
    """How a set is judged: the recipe, and where it stands; None for a recipe's defaults."""

    recipe: Recipe | None
    path: Path | None


def inspect_set(
    set_path: Path, recipe_path: Path | None, report: Path | None, *, as_json: bool
) -> int:
    """Judge stored pictures of one part.

    Parameters
    ----------
    set_path : the set of views
    recipe_path : with the limits, None for a recipe's defaults
    report : file to write, None for none
    as_json : print JSON lines instead of a table

    Returns
    -------
    exit code: 0 for a pass, else 1
    """
    started = time.monotonic()
    if report is not None:
        _check_report(report)
    file = load_view_set(set_path)
    judged = _judged(recipe_path)
    pictures = read_pictures(set_path, file)
    part = _part(set_path, file)
    _check_same_part(file, judged)
    settings = settings_of(judged, part)
    views = build_view_set(file, part, pictures, settings.limits)
    found = inspect_part(views, characteristics_of(file, judged, part), settings)
    lines = list(json_lines(found, time.monotonic() - started))
    if as_json:
        for line in lines:
            emit(line)
    else:
        print_part(part.solid.name, found)
    if report is not None:
        write_page(json.dumps(lines, indent=1, ensure_ascii=False) + "\n", report)
        (warn if as_json else print_line)(f"report: {report}")
    return 0 if found.verdict is Verdict.PASS else 1


def read_pictures(set_path: Path, file: ViewSetFile) -> dict[str, dict[str, Grey]]:
    """Return the pictures of a set, by view id and lamp.

    Parameters
    ----------
    set_path : named in messages
    file : the set

    Raises
    ------
    ConfigError : pictures are missing, cut off, of another size or not grey of 8 bits; all are
        named at once
    """
    found: dict[str, dict[str, Grey]] = {}
    problems: list[str] = []
    for i, view in enumerate(file.views):
        size_px = (view.camera or file.camera).size_px
        of_view = found[view.id] = {}
        for lamp, path in view.pictures.items():
            try:
                of_view[lamp] = read_grey(path, size_px)
            except ConfigError as error:
                problems.append(f"{set_path}: `views.{i}.pictures.{lamp}`: {error}")
    if len(problems) > MAX_PROBLEM_COUNT:
        more = f"{set_path}: and {len(problems) - MAX_PROBLEM_COUNT} more like these"
        problems = [*problems[:MAX_PROBLEM_COUNT], more]
    if problems:
        raise ConfigError("\n".join(problems))
    return found


def settings_of(judged: Judged, part: CompiledPart) -> PartSettings:
    """Return how strictly a part is judged.

    Raises
    ------
    ConfigError : the recipe leaves out a face that the part does not have
    """
    if judged.recipe is None or judged.path is None:
        return PartSettings(InspectionLimits())
    section = judged.recipe.inspection
    return PartSettings(
        InspectionLimits(smallest_defect_mm=section.smallest_defect_mm),
        min_coverage=section.min_coverage,
        not_inspected=faces_left_out(judged.path, judged.recipe, part.solid.faces),
    )


def characteristics_of(
    file: ViewSetFile, judged: Judged, part: CompiledPart
) -> tuple[Characteristic, ...]:
    """Return what is measured: the set's characteristics, else the recipe's, else the CAD file's.

    Parameters
    ----------
    file : the set
    judged : the recipe
    part : with the features that characteristics follow from
    """
    return ()


def _judged(recipe_path: Path | None) -> Judged:
    if recipe_path is None:
        return Judged(None, None)
    path = find_recipe(recipe_path)
    return Judged(load_recipe(path), path)


def _part(set_path: Path, file: ViewSetFile) -> CompiledPart:
    if not file.part.is_file():
        raise ConfigError(f"{set_path}: `part`: no file {file.part}; a CAD file is expected")
    return load_part(file.part, options_among(file.part, file.unit))


def _check_same_part(file: ViewSetFile, judged: Judged) -> None:
    """Warn where the recipe is for another file than the set; raise ConfigError on another part."""
    if judged.recipe is None:
        return
    own = judged.recipe.part
    if part_name(own) != part_name(file.part):
        raise ConfigError(
            f"{judged.path}: `part`: the recipe is for {part_name(own)}, the set shows "
            f"{part_name(file.part)}; choose the recipe of this part"
        )
    if read_bytes(own, MAX_CAD_BYTES, "a CAD file") != read_bytes(
        file.part, MAX_CAD_BYTES, "a CAD file"
    ):
        warn(f"{judged.path}: its CAD file differs from {file.part}, which the part is judged by")


def _check_report(report: Path) -> None:
    """Raise ConfigError where no report can be written."""
    if report.suffix.lower() != ".json":
        raise ConfigError(f"--report {report}: name a file that ends in .json")
    if report.is_dir():
        raise ConfigError(f"--report {report}: is a directory; name a file in it")
    check_writable_folder(report.parent, "--report in")
