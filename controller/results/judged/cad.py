"""The CAD model of a run's part, for drawings: only the file that the run had."""

import glob
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from controller.cad import CadError, Solid
from controller.cad.compiled import load_part, options_among
from controller.cell.services.records import INPUTS
from controller.config import split_cad
from controller.config.cad_files import body_path
from controller.config.files import file_sha256
from messages import key, say

from ..run import PartReport, RunRecord


def solid_in_run(record: RunRecord, part: PartReport) -> Solid | str:
    """Return the CAD model of a part of a run, or why there is none to draw."""
    return solid_of(record.recipe_of(part).recipe, record.files, record.folder)


def solid_of(recipe: Mapping[str, Any], files: Mapping[str, str], folder: Path) -> Solid | str:
    """Return the CAD model of a recipe's part, or why there is none to draw.

    It is read from the run's own copy; a run older than these copies has the file that it read.

    Parameters
    ----------
    recipe : as the run's first row has it
    files : SHA-256 of each file that the run read, by path
    folder : folder of the run
    """
    source = split_cad(Path(str(recipe.get("part", ""))))
    sha256_then = files.get(str(source.file))
    if sha256_then is None:
        return key("the journal does not name the CAD file")
    found = [(path, file_sha256(path)) for path in _copies(source.file, folder) if path.is_file()]
    path = next((path for path, sha256 in found if sha256 == sha256_then), None)
    if path is None and not found:
        return say("the CAD file {name} is no longer where the run found it", name=source.file.name)
    if path is None:
        return say("the CAD file {name} was changed since the run", name=source.file.name)
    unit = recipe.get("unit")
    try:
        part = path if source.body is None else body_path(path, source.body)
        return load_part(part, options_among(part, str(unit) if unit else None)).solid
    except (CadError, OSError) as error:
        return say("the CAD file {name} cannot be read: {error}", name=path.name, error=error)


def _copies(file: Path, folder: Path) -> Iterator[Path]:
    """Yield where a CAD file may be: in the run's folder by recipe, and where the run read it."""
    inputs = folder / INPUTS
    yield inputs / file.name
    yield from sorted(inputs.glob(f"*/{glob.escape(file.name)}"))
    yield file
    if not file.is_absolute():
        # the run began where its folder of runs is
        yield folder.absolute().parent.parent / file
