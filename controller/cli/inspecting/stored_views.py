"""`cellctl inspect`: read a set of views with its pictures, judge the part, print the result."""

import os
import time
from datetime import UTC, datetime
from pathlib import Path

from controller.config import ConfigError, split_cad
from controller.config.files import file_sha256
from controller.config.view_set import ViewSetFile, load_view_set
from controller.inspection import Verdict
from controller.results.judged import Header
from controller.results.judged.inspected import judged_part
from controller.results.writing import SUFFIXES, write_report
from controller.setup.software import software_versions
from controller.stored import (
    Judging,
    compiled_part,
    face_lines,
    json_lines,
    judge_views,
    judging_of,
    read_pictures,
)

from ..inputs.checks import check_writable_folder
from ..terminal.output import emit, print_line, warn
from .tables import print_part


def inspect_set(
    set_path: Path,
    recipe_path: Path | None,
    report: Path | None,
    learned: Path | None = None,
    *,
    as_json: bool,
) -> int:
    """Judge stored pictures of one part.

    Parameters
    ----------
    set_path : the set of views
    recipe_path : with the limits, None for the set's, or a recipe's defaults
    report : file to write, None for none
    learned : file of what good parts look like, None for the recipe's
    as_json : print JSON lines instead of a table

    Returns
    -------
    exit code: 0 for a pass, else 1
    """
    started, began = time.monotonic(), datetime.now(UTC)
    if report is not None:
        _check_report(report)
    file = load_view_set(set_path)
    judging = judging_of(set_path, file, recipe_path, learned, warn)
    pictures = read_pictures(set_path, file)
    part = compiled_part(set_path, file)
    found = judge_views(file, part, pictures, judging)
    *lines, end = json_lines(found)
    lines += face_lines(found)
    lines.append(end | {"seconds": round(time.monotonic() - started, 3)})
    if as_json:
        for line in lines:
            emit(line)
    else:
        print_part(part.solid.name, found)
    if report is not None:
        about = _header(set_path, file, judging, part.solid.name, began)
        judged = judged_part(found, about, set_path.parent, _files(set_path, file))
        write_report([judged], report, part.solid)
        (warn if as_json else print_line)(f"report: {report}")
    return 0 if found.verdict is Verdict.PASS else 1


def _check_report(report: Path) -> None:
    """Raise ConfigError if no report can be written."""
    if report.suffix.lower() not in SUFFIXES:
        raise ConfigError(f"--report {report}: name a file that ends in {', '.join(SUFFIXES)}")
    if report.is_dir():
        raise ConfigError(f"--report {report}: is a directory; name a file in it")
    check_writable_folder(report.parent, "--report in")


def _header(
    set_path: Path, file: ViewSetFile, judging: Judging, name: str, began: datetime
) -> Header:
    """Return the facts on a part that a report states besides its measurements."""
    recipe = judging.path if judging.path != set_path else None
    cad = split_cad(file.part)
    papers = None if judging.recipe is None else judging.recipe.papers
    return Header(
        part=name,
        recipe="" if recipe is None else recipe.name,
        recipe_sha256="" if recipe is None else file_sha256(recipe),
        cad=cad.name,
        cad_sha256=file_sha256(cad.file),
        software=software_versions(),
        start=began,
        end=datetime.now(UTC),
        papers={} if papers is None else papers.model_dump(),
    )


def _files(set_path: Path, file: ViewSetFile) -> dict[str, dict[str, str]]:
    """Return the pictures' files by view and lamp, as seen from the set."""
    return {
        view.id: {
            lamp: os.path.relpath(path, set_path.parent) for lamp, path in view.pictures.items()
        }
        for view in file.views
    }
