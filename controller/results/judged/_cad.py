"""The CAD model of a run's part, for drawings: only the file that the run had."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from controller.cad import CadError, Solid
from controller.cad.compiled import load_part, options_among
from controller.config import split_cad
from controller.config.cad_files import body_path

from ..run import PartReport, RunRecord


def solid_in_run(record: RunRecord, part: PartReport) -> Solid | str:
    """Return the CAD model of a part of a run, or why there is none to draw."""
    return solid_of(record.recipe_of(part).recipe, record.files, record.folder)


def solid_of(recipe: Mapping[str, Any], files: Mapping[str, str], folder: Path) -> Solid | str:
    """Return the CAD model of a recipe's part, or why there is none to draw.

    Parameters
    ----------
    recipe : as the run's first row has it
    files : SHA-256 of each file that the run read, by path
    folder : of the run
    """
    name = Path(str(recipe.get("part", "")))
    source = split_cad(name)
    path, sha256_then = source.file, files.get(str(source.file))
    if sha256_then is None:
        return "the journal does not name the CAD file"
    if not path.is_absolute() and not path.is_file():
        # the run began where its folder of runs is
        path = folder.absolute().parent.parent / path
    try:
        sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return f"the CAD file {path.name} is no longer where the run found it"
    if sha256 != sha256_then:
        return f"the CAD file {path.name} was changed since the run"
    unit = recipe.get("unit")
    try:
        part = path if source.body is None else body_path(path, source.body)
        return load_part(part, options_among(part, str(unit) if unit else None)).solid
    except (CadError, OSError) as error:
        return f"the CAD file {path.name} cannot be read: {error}"
